"""Driver profiles of the Intelligent Driver Model."""

from __future__ import annotations

from dataclasses import dataclass

from scex_sumo.arrays import FloatArray
from scex_sumo.behaviors.driving.paths import PathChoice
from scex_sumo.behaviors.parameters import check_path, check_positive


@dataclass(frozen=True, kw_only=True)
class IdmProfile:
    """Driver profile of the Intelligent Driver Model (Treiber et al. 2000).

    Attributes:
        comfort_deceleration: ``b`` in m/s², positive.
        time_headway: ``T`` in s.
        minimum_gap: ``s0`` in m, bumper to bumper.
        max_acceleration: ``a_max`` in m/s².
        max_deceleration: physical limit of braking in m/s²; the formula alone has none.
        speed: desired speed ``v0`` in m/s; 0 takes the speed limit of the lane.
        speed_factor: factor on the speed limit.
        habit_memory: time constant in s with which the desired speed moves from the one that the driver
            shows in the seed scene to the one above; 0 takes the one above at once.
        habit_lead: the speed shown in the seed scene is that in so many s at the acceleration of its last
            half second,
        habit_margin: and so much more, m/s.
        clearance: another vehicle is a leader when its centre is this near to the path, m.
        obstacle_clearance: likewise a pedestrian or cyclist, m.
        radius: perception radius, m.
        curve_acceleration: comfortable lateral acceleration in curves, m/s²; 0 does not slow down for them.
        curve_deceleration: braking before a curve, m/s².
        path: which path to take: index from left to right (clamped to the last; -1 is the rightmost),
            ``straight`` (the straightest from the lane it most probably is on), ``random`` (a fixed draw
            per child and vehicle), lane ids, or points.
    """

    comfort_deceleration: float
    time_headway: float
    minimum_gap: float
    max_acceleration: float
    max_deceleration: float = 9.0
    speed: float = 0.0
    speed_factor: float = 1.0
    habit_memory: float = 0.0
    habit_lead: float = 0.0
    habit_margin: float = 0.0
    clearance: float = 5.0
    obstacle_clearance: float = 1.5
    radius: float = 100.0
    curve_acceleration: float = 0.0
    curve_deceleration: float = 1.0
    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        check_positive(
            self,
            "comfort_deceleration",
            "max_acceleration",
            "max_deceleration",
            "speed_factor",
            "radius",
            "curve_deceleration",
        )
        check_positive(
            self,
            "time_headway",
            "minimum_gap",
            "speed",
            "habit_memory",
            "habit_lead",
            "habit_margin",
            "clearance",
            "obstacle_clearance",
            "curve_acceleration",
            zero=True,
        )
        check_path(self.path)


CALIBRATED = IdmProfile(
    comfort_deceleration=1.21,
    time_headway=0.5,
    minimum_gap=1.0,
    max_acceleration=1.61,
    habit_memory=30.0,
    habit_lead=1.59,
    habit_margin=0.27,
    clearance=1.5,
    curve_acceleration=4.05,
    curve_deceleration=2.18,
)
"""As people drive: fitted by ``benchmarks/calibrate.py``, see `scex_sumo.behaviors.profiles`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class IdmParameters:
    """Parameters of the formula alone, one for all or (n,) one for each vehicle; see `IdmProfile`."""

    time_headway: FloatArray | float
    minimum_gap: FloatArray | float
    max_acceleration: FloatArray | float
    comfort_deceleration: FloatArray | float
    max_deceleration: FloatArray | float

    @classmethod
    def of(
        cls, profile: IdmProfile, *, time_headway: FloatArray, comfort_deceleration: FloatArray
    ) -> IdmParameters:
        """Those of a profile, with the vehicles' own time headways (n,), s, and decelerations (n,), m/s²."""
        return cls(
            time_headway=time_headway,
            minimum_gap=profile.minimum_gap,
            max_acceleration=profile.max_acceleration,
            comfort_deceleration=comfort_deceleration,
            max_deceleration=profile.max_deceleration,
        )
