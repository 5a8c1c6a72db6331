"""Drivers that obey the rules of the road, and such that break one: lights, priority, lanes."""

from __future__ import annotations

from dataclasses import dataclass, replace

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.base import check_positive
from scex_sumo.behaviors.driving.motion import Intent
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.models.idm import IdmDriver, IdmProfile
from scex_sumo.road import Road
from scex_sumo.scene import SceneHistory, VehicleIndex

SIDEWAYS = ("", "cuts_in", "drifts")


@dataclass(frozen=True, kw_only=True)
class RuledProfile(IdmProfile):
    """Driver profile with rules; they count where the scene has some.

    Attributes:
        lights: whether it stops at lights; ``priority``: whether it gives way, also to people on crosswalks.
        yellow_deceleration: hardest braking for a yellow light, m/s²; 0 drives on.
        red_delay: time for which red counts as yellow, s.
        gap_factor: on the critical headways of `rules.holds`.
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

    def intend(self, history: SceneHistory, road: Road, who: VehicleIndex) -> Intent:
        """See `DrivesAlong`."""
        profile = self.profile
        paths, row = chosen_paths(history, road, who, profile.path)
        hold: FloatArray | None = None
        if history.scene.rules is not None and not isinstance(profile.path, tuple):
            from scex_sumo.rules.holds import Manner, lights, obeyed
            from scex_sumo.rules.states import straight_traffic

            manner = Manner(
                lights=profile.lights,
                priority=profile.priority,
                yellow_mps2=profile.yellow_deceleration,
                red_mps2=profile.max_deceleration,
                red_delay_s=profile.red_delay,
                gaps=profile.gap_factor,
                priority_mps2=profile.comfort_deceleration,
            )
            lit = lights(history, paths)
            hold = obeyed(history, who, paths, row, straight_traffic(history, paths), manner, lit).hold
        intent = self.follow(history, who, paths, row, hold)
        if not profile.sideways:
            return intent
        from scex_sumo.rules.sideways import offsets

        return replace(intent, aside=offsets(history, road, paths, intent.row, intent.who, profile.sideways))
