"""Learned models that the wing registers; making one loads its network."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.learned.profiles import (
    GraphImagePredictorProfile,
    GraphPredictorProfile,
    JointPredictorProfile,
)

if TYPE_CHECKING:
    from scex_sumo.learned.driver import LearnedDriver


def learned(kind: str, profile: GraphPredictorProfile) -> LearnedDriver:
    """Make a learned driver; ``kind`` is that of its network, as in ``scex-sumo train``."""
    if kind == "joint":
        from scex_sumo.learned.joint import JointDriver

        return JointDriver(kind, profile)
    from scex_sumo.learned.driver import LearnedDriver

    return LearnedDriver(kind, profile)


def _entry(kind: str, profile: GraphPredictorProfile, **given: Any) -> ModelEntry:
    make = partial(learned, kind)
    return ModelEntry(make=make, profile=profile, path_words=("likeliest",), is_own=False, **given)


GRAPH_PREDICTOR = _entry(
    "graph",
    GraphPredictorProfile(),
    summary="learned: motion along its path, from the semantic scene graph",
    place=70,
)
GRAPH_IMAGE_PREDICTOR = _entry(
    "hybrid",
    GraphImagePredictorProfile(),
    summary="learned: motion from the scene graph and the road seen from above, weighed by attention",
    place=80,
)
JOINT_PREDICTOR = _entry(
    "joint",
    JointPredictorProfile(),
    summary="learned: the motion of all vehicles drawn together, every 0.5 s",
    place=90,
)
