"""Replay of the recorded future, for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.behaviors.base import PLAN_STEPS, Sight
from scex_sumo.behaviors.driving.motion import drive_along
from scex_sumo.behaviors.driving.paths import PathChoice
from scex_sumo.behaviors.parameters import check_path
from scex_sumo.errors import UsageError
from scex_sumo.road import Road
from scex_sumo.scene import Plan, SceneHistory, States, Who


@dataclass(frozen=True, kw_only=True)
class ReplayProfile:
    """Parameters of `Replay`.

    Attributes:
        path: which path to take once the recording has ended, as in `IdmProfile`.
    """

    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        check_path(self.path)


class Replay:
    """Repeats the recorded future; where that has ended, goes on along the path at the speed it had."""

    def __init__(self, profile: ReplayProfile) -> None:
        self.profile = profile

    @property
    def sight(self) -> Sight | None:
        """What decides on a plan; a path that is drawn differs between children."""
        return None if self.profile.path == "random" else "itself"

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing.

        Raises:
            UsageError: the seed scene has no recorded future.
        """
        scene = history.scene
        if scene.future is None or scene.future_valid is None:
            raise UsageError(
                f"replay: seed scene {scene.name} has no recorded future; "
                "choose other models or a recorded seed"
            )
        # Valid up to the first gap.
        known = np.cumprod(scene.future_valid, axis=1).sum(axis=1)[who.vehicle]
        left = np.clip(known - history.step, 0, PLAN_STEPS)  # (n,) recorded steps from now on
        recorded = scene.future[who.vehicle]
        last = np.clip(history.step + left - 1, 0, recorded.shape[1] - 1)
        i = np.arange(len(who))
        ends = [recorded[i, last], history.now[who.child, who.vehicle]]
        end = States.joined(ends, lambda parts: np.where(left > 0, *parts))
        h = np.arange(PLAN_STEPS)
        made = recorded[:, np.minimum(history.step + h, recorded.shape[1] - 1)]
        ending = np.flatnonzero(left < PLAN_STEPS)
        some = Who(child=who.child[ending], vehicle=who.vehicle[ending])
        rest = drive_along(history, road, some, self.profile.path, start=end[ending])
        row, step = np.nonzero(h >= left[ending, None])
        made.assign((ending[row], step), rest[row, step - left[ending[row]]])
        return Plan(**vars(made))
