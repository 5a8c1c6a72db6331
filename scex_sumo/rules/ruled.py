"""Drivers that obey the rules of the road, and such that break one: lights, priority, lanes."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import check_positive
from scex_sumo.behaviors.driving.motion import Intent
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.models.idm import IdmDriver, IdmProfile
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
        profile = self.profile
        return RuledDriver, profile.path, profile.clearance, profile.obstacle_clearance, profile.radius

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent:
        """See `DrivesAlong`."""
        return self.intend_together([self], history, road, [vehicles])[0]

    @staticmethod
    def intend_together(
        drivers: Sequence[RuledDriver], history: SceneHistory, road: Road, groups: Sequence[VehicleIndex]
    ) -> list[Intent]:
        """See `DrivesAlong`."""
        vehicles = VehicleIndex(
            future=np.concatenate([group.future for group in groups]),
            vehicle=np.concatenate([group.vehicle for group in groups]),
        )
        path = drivers[0].profile.path
        paths, row = chosen_paths(history, road, vehicles, path)
        hold: FloatArray | None = None
        arc_length: FloatArray | None = None
        if history.scene.rules is not None:
            from scex_sumo.rules.holds import lights, obeyed
            from scex_sumo.rules.states import straight_traffic

            manner, traffic = _manner(drivers, groups), straight_traffic(history, paths)
            hold = obeyed(history, vehicles, paths, row, traffic, manner, lights(history, paths)).hold
            arc_length = traffic.arc_length[vehicles.future, vehicles.vehicle] if path == "straight" else None
        leaders = drivers[0].look(history, vehicles, paths, row, arc_length)
        intents, end = [], 0
        for driver, group in zip(drivers, groups, strict=True):
            k = slice(end, end := end + len(group))
            held = None if hold is None else hold[k]
            intent = driver.behind(leaders.take(k), history, group, paths, row[k], held)
            if sideways := driver.profile.sideways:
                from scex_sumo.rules.sideways import offsets

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
