"""Intelligent Driver Model along a path: standard, risky and calibrated driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, clipped, distinct
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.base import Sight, check_path, check_positive
from scex_sumo.behaviors.driving.leaders import Leaders, find_leaders
from scex_sumo.behaviors.driving.motion import (
    CURVE_TIME_S,
    REAR_AXLE_SHARE,
    Accelerate,
    DrivesAlong,
    Intent,
    curve_speeds,
    own_motion,
)
from scex_sumo.behaviors.driving.paths import OnPath, PathChoice, SeedPaths, chosen_paths, path_positions
from scex_sumo.scene import STEP_S, SceneHistory, VehicleIndex

if TYPE_CHECKING:
    from scex_sumo.road import Road

LINE_GAP_M = 0.5  # before a place to stop
LINE_BRAKING = 0.7  # of the comfortable deceleration, for one
POSITIVE = {
    *("comfort_deceleration", "max_acceleration", "max_deceleration", "speed_factor", "radius"),
    "curve_deceleration",
}
HABIT_STEPS = 5  # over which the acceleration before the seed scene is measured


@dataclass(frozen=True, kw_only=True)
class IdmParameters:
    """Parameters of the formula (Treiber et al. 2000), one for all or (n,) one per vehicle.

    Attributes:
        comfort_deceleration: ``b`` in m/s², positive.
        time_headway: ``T`` in s.
        minimum_gap: ``s0`` in m, bumper to bumper.
        max_acceleration: ``a_max`` in m/s².
        max_deceleration: braking limit in m/s².
    """

    comfort_deceleration: FloatArray | float
    time_headway: FloatArray | float
    minimum_gap: FloatArray | float
    max_acceleration: FloatArray | float
    max_deceleration: FloatArray | float = 9.0


@dataclass(frozen=True, kw_only=True)
class IdmProfile(IdmParameters):
    """Driver profile of the Intelligent Driver Model.

    Attributes:
        speed: desired speed ``v0`` in m/s; 0 takes the lane's speed limit.
        speed_factor: factor on the speed limit.
        habit_memory: time constant in s with which the desired speed moves from the one shown in the seed
            scene to ``v0``; 0 takes ``v0`` at once.
        habit_lead: time in s over which the last half second's acceleration changes the shown speed.
        habit_margin: addition to the shown speed in m/s.
        clearance: a vehicle is a leader if its centre is this near to the path, m.
        radius: perception radius, m.
        curve_acceleration: comfortable lateral acceleration in m/s²; 0 does not slow down for curves.
        curve_deceleration: braking before a curve in m/s².
        path: index from left to right (clamped to the last; -1 is the rightmost), ``straight`` (the
            straightest from the most probable lane) or ``random`` (drawn per future and vehicle).
    """

    speed: float = 0.0
    speed_factor: float = 1.0
    habit_memory: float = 0.0
    habit_lead: float = 0.0
    habit_margin: float = 0.0
    clearance: float = 5.0
    radius: float = 100.0
    curve_acceleration: float = 0.0
    curve_deceleration: float = 1.0
    path: PathChoice = "straight"

    def __post_init__(self) -> None:
        for name in IdmProfile.__dataclass_fields__:
            if name != "path":
                check_positive(self, name, zero=name not in POSITIVE)
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
"""``calibrated_driver``: fitted by ``benchmarks/calibrate.py`` to the training part of TAF-BW and MONA.

Clearance and memory are not fitted, because 3 s of driving do not show them.
"""


def idm_acceleration(
    profile: IdmParameters,
    speed: FloatArray,
    desired_speed: FloatArray,
    gap: FloatArray,
    leader_speed: FloatArray,
) -> FloatArray:
    """Return (n,) accelerations of the Intelligent Driver Model, m/s².

    a = a_max·(1 - (v/v0)⁴ - (s*/s)²), s* = s0 + max(0, v·T + v·Δv / (2·√(a_max·b))), not below
    -max_deceleration, with speed v, desired speed v0, gap s (inf without a leader) and Δv the own speed minus
    the leader's along the path, (n,) in m and m/s. A gap below 0.1 m counts as 0.1 m. Below v0 = 0.1 m/s the
    driver does not accelerate.

    Source: Treiber, Hennecke, Helbing 2000; lower bound on s*: Treiber and Kesting 2013.
    """
    share = free_share(speed, desired_speed) - leader_share(profile, speed, gap, leader_speed)
    return np.maximum(profile.max_acceleration * share, -profile.max_deceleration)


def free_share(speed: FloatArray, desired_speed: FloatArray, exponent: float = 4) -> FloatArray:
    """Return (n,) shares of a_max without a leader: 1 - (v/v0)^exponent."""
    free = 1 - (speed / np.maximum(desired_speed, 0.1)) ** exponent
    return np.where(desired_speed < 0.1, np.minimum(free, 0.0), free)


def leader_share(
    profile: IdmParameters, speed: FloatArray, gap: FloatArray, leader_speed: FloatArray
) -> FloatArray:
    """Return (n,) shares of a_max that a leader takes from that: (s*/s)²."""
    hardness = 2 * np.sqrt(profile.max_acceleration * profile.comfort_deceleration)
    braking = speed * (speed - leader_speed) / hardness
    wanted = profile.minimum_gap + np.maximum(speed * profile.time_headway + braking, 0.0)
    return np.asarray((wanted / np.maximum(gap, 0.1)) ** 2)


def holding_acceleration(profile: IdmParameters, speed: FloatArray, gap: FloatArray) -> FloatArray:
    """Return (n,) accelerations that end at places to stop, m/s²: a_max·(1 - (s*/s)²); inf without."""
    slowing = profile.max_acceleration * (1 - leader_share(profile, speed, gap, np.zeros_like(gap)))
    return np.where(np.isfinite(gap), np.maximum(slowing, -profile.max_deceleration), np.inf)


class IdmDriver(DrivesAlong):
    """Follows its path at the desired speed, and keeps its distance to the leader, which keeps its speed."""

    sees: ClassVar[Sight] = "everyone"
    profile: IdmProfile

    def intend(self, history: SceneHistory, road: Road, vehicles: VehicleIndex) -> Intent:
        """See `DrivesAlong`."""
        return self.follow(history, vehicles, *chosen_paths(history, road, vehicles, self.profile.path))

    def follow(
        self, history: SceneHistory, vehicles: VehicleIndex, paths: SeedPaths, row: IntArray
    ) -> Intent:
        """Return the drive along (n,) rows of `paths`."""
        s, _, _ = path_positions(history, vehicles, paths, row)
        near = {"clearance": self.profile.clearance, "radius": self.profile.radius}
        leaders = find_leaders(history, vehicles, paths, row, s, **near)
        return self.behind(leaders, OnPath(history, vehicles, paths, row))

    def behind(self, leaders: Leaders, on: OnPath, hold: FloatArray | None = None) -> Intent:
        """Return the drive behind leaders; ``hold`` (n,): ways to places to stop, m, inf without."""
        # Vehicles with the same leader at the same gap drive the same; many futures differ elsewhere only.
        holds = [] if hold is None else [hold]
        situation = np.stack([on.row, leaders.gap, leaders.speed, *holds], axis=1)
        first, kind = distinct(np.concatenate([own_motion(on.history, on.vehicles), situation], axis=1))
        distinct_on = on._replace(vehicles=on.vehicles[first], row=on.row[first])
        accelerate = self._accelerate(distinct_on, leaders.take(first), None if hold is None else hold[first])
        return Intent(distinct_on.vehicles, distinct_on.paths, distinct_on.row, accelerate, kind)

    def _accelerate(self, on: OnPath, leaders: Leaders, hold: FloatArray | None) -> Accelerate:
        """Return accelerations behind leaders of constant speed, and before places to stop."""
        history, vehicles, paths, row = on
        profile = self.profile
        wished = desired_speeds(paths, profile.speed, profile.speed_factor)
        comfort = profile.curve_acceleration, profile.curve_deceleration
        curves = curve_speeds(paths, *comfort) if profile.curve_acceleration > 0 else None
        habit = seed_motion(history, vehicles)
        to_line = IdmParameters(
            comfort_deceleration=LINE_BRAKING * profile.comfort_deceleration,
            time_headway=0.0,
            minimum_gap=LINE_GAP_M,
            max_acceleration=profile.max_acceleration,
            max_deceleration=profile.max_deceleration,
        )
        # speeds are those at the centre, while the rear axle follows the table
        ahead = REAR_AXLE_SHARE * history.scene.length[vehicles.vehicle]

        def at(s: FloatArray) -> IntArray:
            return paths.sample_at(row, s + ahead)

        def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
            gap = leaders.gap + leaders.speed * (step * STEP_S) - travelled
            time_s = (history.step + step) * STEP_S
            desired = desired_speed(profile, wished[at(s)], v, *habit, time_s)
            a = idm_acceleration(profile, v, desired, gap, leaders.speed)
            if curves is not None:
                # A moment ahead, so that the car does not lag behind.
                slowing = (curves[at(s + v * CURVE_TIME_S)] - v) / CURVE_TIME_S
                a = np.minimum(a, np.maximum(slowing, -profile.comfort_deceleration))
            if hold is not None:
                a = np.minimum(a, holding_acceleration(to_line, v, hold - travelled))
            return a

        return accelerate


def seed_motion(history: SceneHistory, vehicles: VehicleIndex) -> tuple[FloatArray, FloatArray]:
    """Return (n,) speed in the seed scene, m/s, and mean acceleration over the half second before, m/s²."""
    speed = history.scene.history.speed[vehicles.vehicle]
    acceleration = (speed[:, -1] - speed[:, -1 - HABIT_STEPS]) / (HABIT_STEPS * STEP_S)
    return np.maximum(speed[:, -1], 0.0), acceleration


def desired_speed(
    profile: IdmProfile,
    wished: FloatArray,
    present: FloatArray,
    speed: FloatArray,
    acceleration: FloatArray,
    time_s: float,
) -> FloatArray:
    """Return (n,) desired speeds of drivers that keep their behaviour of the seed scene for a while, m/s.

    v0(t) = w + (h - w)·exp(-t/τ), h = v + k·a + m, with the wished speed w (n,), m/s, the speed v (n,), m/s,
    and the acceleration a (n,), m/s², of the seed scene, lead k, margin m and memory τ; h is at least 0 and
    at most the larger of w and v. v0 asks for no braking harder than b at the ``present`` speed (n,), m/s.
    """
    if profile.habit_memory == 0:
        return wished
    shown = speed + profile.habit_lead * acceleration + profile.habit_margin
    shown = clipped(shown, 0.0, np.maximum(wished, speed))
    desired = wished + (shown - wished) * np.exp(-time_s / profile.habit_memory)
    gentle = (1 + profile.comfort_deceleration / profile.max_acceleration) ** -0.25
    return np.asarray(np.maximum(desired, gentle * present))


@owner_cache
def desired_speeds(paths: SeedPaths, speed: float, factor: float) -> FloatArray:
    """Return (P * N,) desired speeds along all paths, m/s; off the mapped lanes the vehicle's own speed."""
    wished = np.full_like(paths.speed_limit, speed) if speed > 0 else factor * paths.speed_limit
    off = np.repeat(~paths.on_road, paths.count)
    return np.where(off[:, None], paths.speed_limit, wished).ravel()
