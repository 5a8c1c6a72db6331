"""Drivers that obey the rules of the road, and such that break one: lights, priority, lanes."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import check_positive
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.motion import Intent
from scex_sumo.behaviors.driving.paths import OnPath, chosen_paths, path_positions
from scex_sumo.behaviors.models.idm import IdmDriver, IdmProfile
from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.rules.holds import Manner

SIDEWAYS = ("", "cuts_in", "drifts")


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
        paths, row = chosen_paths(history, road, vehicles, drivers[0].profile.path)
        hold: FloatArray | None = None
        if history.scene.rules is not None:
            from scex_sumo.rules.holds import lights, obeyed
            from scex_sumo.rules.passages import straight_traffic

            manner, traffic = _manner(drivers, groups), straight_traffic(history, paths)
            on = OnPath(history, vehicles, paths, row)
            hold = obeyed(on, traffic, manner, lights(history, paths)).hold
        s, _, _ = path_positions(history, vehicles, paths, row)
        near = {"clearance": drivers[0].profile.clearance, "radius": drivers[0].profile.radius}
        leaders = find_leaders(history, vehicles, paths, row, s, **near)
        intents, end = [], 0
        for driver, group in zip(drivers, groups, strict=True):
            k = slice(end, end := end + len(group))
            held = None if hold is None else hold[k]
            intent = driver.behind(leaders.take(k), OnPath(history, group, paths, row[k]), held)
            if sideways := driver.profile.sideways:
                from scex_sumo.rules.sideways import offsets

                aside = offsets(history, road, paths, intent.row, intent.vehicles, sideways)
                intent = replace(intent, aside=aside)
            intents.append(intent)
        return intents


def _manner(drivers: Sequence[RuledDriver], groups: Sequence[VehicleIndex]) -> Manner:
    """Return the manner of each of the n vehicles."""
    from scex_sumo.rules.holds import Manner

    counts = [len(group) for group in groups]

    def each(name: str) -> FloatArray:
        return np.repeat([float(getattr(driver.profile, name)) for driver in drivers], counts)

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
