"""Models that the wing registers: the three learned drivers."""

from __future__ import annotations

from functools import partial

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.learned.models import GraphImagePredictor, GraphPredictor, JointPredictor
from scex_sumo.learned.profiles import (
    GraphImagePredictorProfile,
    GraphPredictorProfile,
    JointPredictorProfile,
)

_learned = partial(ModelEntry, path_words=("likeliest",), is_own=False)

GRAPH_PREDICTOR = _learned(
    make=GraphPredictor,
    profile=GraphPredictorProfile(),
    summary="learned: motion along its path, from the semantic scene graph",
    place=70,
)
GRAPH_IMAGE_PREDICTOR = _learned(
    make=GraphImagePredictor,
    profile=GraphImagePredictorProfile(),
    summary="learned: motion from the scene graph and the road seen from above, weighed by attention",
    place=80,
)
JOINT_PREDICTOR = _learned(
    make=JointPredictor,
    profile=JointPredictorProfile(),
    summary="learned: the motion of all vehicles drawn together, every 0.5 s",
    place=90,
)
