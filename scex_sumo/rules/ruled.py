"""Drivers that obey the rules of the road, and such that break one: lights, priority, lanes."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS, check_positive
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.motion import Intent
from scex_sumo.behaviors.driving.paths import SeedPaths, chosen_paths, path_positions
from scex_sumo.behaviors.models.idm import IdmDriver, IdmProfile
from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.rules.holds import Manner

SIDEWAYS = ("", "cuts_in", "drifts")
CHANGE_S = 3.0  # of a lane change, as SUMO's here
DRIFT_MPS = 0.8  # the fastest departure of ISO 17361, lane departure warning
DRIFT_M = 3.5
NEAR_M = 30.0  # along the way, to a vehicle beside
BESIDE_M = 1.5, 6.0  # across the way
LEFT, RIGHT = 1.0, -1.0


@dataclass(frozen=True, kw_only=True)
class RuledProfile(IdmProfile):
    """Driver profile with rules; they count where the scene has some.

    Attributes:
        lights: whether it stops at lights.
        priority: whether it gives way, also to people on crosswalks.
        yellow_deceleration: hardest braking for a yellow light, m/s²; 0 drives on.
        red_delay: time for which red counts as yellow, s.
        gap_factor: factor on the critical headways into which it turns, crosses and merges.
        sideways: ``cuts_in`` changes to the lane beside it in which a vehicle is nearest, ``drifts`` leaves
            its lane towards the nearest vehicle.
    """

    lights: bool = True
    priority: bool = True
    yellow_deceleration: float = 3.0
    red_delay: float = 0.0
    gap_factor: float = 1.0
    sideways: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "yellow_deceleration", "red_delay", "gap_factor", zero=True)
        if self.sideways not in SIDEWAYS:
            raise UsageError(f"sideways: got {self.sideways!r}; give {' or '.join(SIDEWAYS[1:])}")


class RuledDriver(IdmDriver):
    """Intelligent driver that also stops at lights, lines and crosswalks, and gives way."""

    profile: RuledProfile

    @property
    def looks(self) -> Hashable:
        """See `DrivesAlong`."""
        return RuledDriver, self.profile.path, self.profile.clearance, self.profile.radius

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent:
        """See `DrivesAlong`."""
        return self.intend_together([self], history, road, [vehicles])[0]

    @staticmethod
    def intend_together(
        drivers: Sequence[RuledDriver], history: SceneHistory, road: Road, groups: Sequence[VehicleIndex]
    ) -> list[Intent]:
        """See `DrivesAlong`."""
        vehicles = VehicleIndex.join(groups)
        path = drivers[0].profile.path
        paths, row = chosen_paths(history, road, vehicles, path)
        hold: FloatArray | None = None
        if history.scene.rules is not None:
            from scex_sumo.rules.holds import lights, obeyed
            from scex_sumo.rules.passages import straight_traffic

            manner, traffic = _manner(drivers, groups), straight_traffic(history, paths)
            hold = obeyed(history, vehicles, paths, row, traffic, manner, lights(history, paths)).hold
        if hold is not None and path == "straight":
            s = traffic.arc_length[vehicles.future, vehicles.vehicle]
        else:
            s, _, _ = path_positions(history, vehicles, paths, row)
        near = {"clearance": drivers[0].profile.clearance, "radius": drivers[0].profile.radius}
        leaders = find_leaders(history, vehicles, paths, row, s, **near)
        intents, end = [], 0
        for driver, group in zip(drivers, groups, strict=True):
            k = slice(end, end := end + len(group))
            held = None if hold is None else hold[k]
            intent = driver.behind(leaders.take(k), history, group, paths, row[k], held)
            if sideways := driver.profile.sideways:
                aside = offsets(history, road, paths, intent.row, intent.vehicles, sideways)
                intent = replace(intent, aside=aside)
            intents.append(intent)
        return intents


def _manner(drivers: Sequence[RuledDriver], groups: Sequence[VehicleIndex]) -> Manner:
    """Return the manner of each of the n vehicles."""
    from scex_sumo.rules.holds import Manner

    profiles, counts = [driver.profile for driver in drivers], [len(group) for group in groups]

    def each(name: str) -> FloatArray:
        return np.repeat([float(getattr(profile, name)) for profile in profiles], counts)

    return Manner(
        lights=each("lights"),
        priority=each("priority"),
        yellow_mps2=each("yellow_deceleration"),
        red_mps2=each("max_deceleration"),
        red_delay_s=each("red_delay"),
        gaps=each("gap_factor"),
        priority_mps2=each("comfort_deceleration"),
    )


_rule = partial(ModelEntry, make=RuledDriver, may_fail=False, is_own=False)

# Parameters of the standard and the risky driver: Zipfl, Schütt, Zöllner 2024, except max_acceleration, which
# the paper does not state, and those of the rules.
_STANDARD = RuledProfile(
    comfort_deceleration=3.0, time_headway=3.1, minimum_gap=9.0, max_acceleration=1.5, clearance=5.0
)
_RISKY = RuledProfile(
    comfort_deceleration=8.0,
    time_headway=2.1,
    minimum_gap=5.0,
    max_acceleration=3.0,
    clearance=5.0,
    yellow_deceleration=0.0,
    red_delay=1.0,
    gap_factor=0.5,
)


def _violation(what: str, place: int, **changes: Any) -> ModelEntry:
    """Return the standard driver but for one thing."""
    summary = f"standard_driver that {what}"
    return _rule(profile=replace(_STANDARD, **changes), summary=summary, place=place)


STANDARD_DRIVER = _rule(
    profile=_STANDARD,
    summary="Intelligent Driver Model, the paper's standard profile; obeys lights and right of way",
    place=10,
)
RISKY_DRIVER = _rule(
    profile=_RISKY,
    summary="Intelligent Driver Model, the paper's risky profile: close, fast, in short gaps, at yellow",
    place=20,
)
RUNS_RED = _violation("does not stop at lights", 71, lights=False)
IGNORES_PRIORITY = _violation("gives way to nobody", 72, priority=False)
CUTS_IN = _violation("changes to a lane beside it without looking", 73, sideways="cuts_in")
DRIFTS = _violation("leaves its lane sideways", 74, sideways="drifts")


def offsets(
    history: SceneHistory, road: Road, paths: SeedPaths, row: IntArray, vehicles: VehicleIndex, kind: str
) -> FloatArray:
    """Return (n, 31) wanted offsets from the path, m, left positive, from the seed moment on.

    Towards the side on which another vehicle is nearest, else left; ``kind``: ``cuts_in`` or ``drifts``.
    """
    nearest = _nearest(history.scene)[vehicles.vehicle]
    time_s = STEP_S * (history.step + np.arange(PLAN_STEPS + 1.0))
    if kind == "drifts":
        side = np.where(nearest[:, 1] < nearest[:, 0], RIGHT, LEFT)
        return np.asarray(side[:, None] * np.minimum(DRIFT_MPS * time_s, DRIFT_M))
    width = np.array([_lane_widths(road, paths.lanes[k][:1]) for k in row.tolist()]).reshape(-1, 2)
    nearest = np.where(width > 0, nearest, np.inf)
    right = (nearest[:, 1] < nearest[:, 0]) | (width[:, 0] == 0)
    u = np.minimum(time_s / CHANGE_S, 1.0)
    way: FloatArray = np.where(right, -width[:, 1], width[:, 0])[:, None]
    return np.asarray(way * (u**3 * (10 - 15 * u + 6 * u**2)))


@owner_cache
def _nearest(scene: SeedScene) -> FloatArray:
    """Return (V, 2) distances along the way to the nearest vehicle on the left and on the right, m."""
    ahead, left = scene.now[:, None].ahead_and_left(scene.now.x, scene.now.y)
    aside = np.stack([LEFT * left, RIGHT * left], axis=1)  # (V, 2, V)
    beside = (aside > BESIDE_M[0]) & (aside < BESIDE_M[1]) & (np.abs(ahead) < NEAR_M)[:, None]
    return np.asarray(np.where(beside, np.abs(ahead)[:, None], np.inf).min(axis=2, initial=np.inf))


def _lane_widths(road: Road, lanes: tuple[int, ...]) -> tuple[float, float]:
    """Return the ways to the lanes on the left and right to which a change is allowed, m; 0 without."""
    if not lanes:
        return 0.0, 0.0
    lane = road.lanes[lanes[0]]
    beside = (None if i is None else road.lanes.get(i) for i in (lane.left, lane.right))
    left, right = ((lane.width_m + other.width_m) / 2 if other is not None else 0.0 for other in beside)
    return left, right
