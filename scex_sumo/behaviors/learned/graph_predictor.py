"""Graph Predictor: motion along the path, learned from recordings, from the semantic scene graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from scex_sumo.behaviors.learned.extra import check_libraries
from scex_sumo.behaviors.parameters import check_path, check_positive
from scex_sumo.behaviors.paths import PathChoice
from scex_sumo.errors import UsageError
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, Who

if TYPE_CHECKING:
    from scex_sumo.behaviors.learned.driver import LearnedDriver

SHIPPED = Path(__file__).parents[1] / "weights"
MODES = ("best", "draw")


@dataclass(frozen=True, kw_only=True)
class GraphPredictorProfile:
    """Parameters of `GraphPredictor`.

    Attributes:
        path: which path to take, as in `IdmProfile`; or ``likeliest``, the one that the network thinks it
            takes, from the seed scene.
        mode: ``best``, what the network expects; or ``draw``, one of its modes for each vehicle of a child,
            as often as it is probable in the seed scene.
        radius: perception radius, m.
        weights: file of weights; empty takes the shipped ones.
    """

    path: PathChoice | Literal["likeliest"] = "straight"
    mode: str = "best"
    radius: float = 100.0
    weights: str = ""

    def __post_init__(self) -> None:
        check_learned(self)


def check_learned(profile: Any) -> None:
    """Raise a `UsageError` unless path, mode, radius and weights of a learned driver make sense."""
    if profile.path != "likeliest":
        check_path(profile.path)
    if profile.mode not in MODES:
        raise UsageError(f"mode: got {profile.mode!r}; give {' or '.join(MODES)}")
    check_positive(profile, "radius")
    if not isinstance(profile.weights, str):
        raise UsageError(f"weights: got {profile.weights!r}; give the name of a file")


def weights_file(name: str, given: str) -> Path:
    """The file of weights of a learned driver: the user's, else the shipped one."""
    return Path(given).expanduser().absolute() if given else SHIPPED / f"{name}.pt"


class GraphPredictor:
    """Drives along its path with the accelerations and the offset that a graph network predicts.

    The network sees all vehicles with their last second, related by the lanes, the path ahead and who is on
    it. Vehicles off the map are left to the path-following driver.
    """

    def __init__(self, profile: GraphPredictorProfile) -> None:
        check_libraries("graph_predictor")
        self.profile = profile
        self.driver.meta  # noqa: B018  unusable weights are said before anything runs

    @cached_property
    def driver(self) -> LearnedDriver:
        """The network."""
        from scex_sumo.behaviors.learned.driver import LearnedDriver

        file = weights_file("graph_predictor", self.profile.weights)
        return LearnedDriver("graph", file, self.profile, attention=1.0, free=False)

    @property
    def weights_sha256(self) -> str:
        """Of the file of weights."""
        return self.driver.sha256

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing."""
        return self.driver.plan(history, road, who, rng)
