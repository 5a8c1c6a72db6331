"""The Intelligent Driver Model along a path: standard, risky and calibrated driver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray, distinct
from scex_sumo.behaviors.base import Sight
from scex_sumo.behaviors.driving.distinct import own_motion
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.motion import REAR_AXLE_SHARE, Accelerate, curve_speeds
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths, chosen_paths
from scex_sumo.behaviors.driving.projection import clipped, expected_way, foot_points
from scex_sumo.behaviors.driving.together import Intent, driven
from scex_sumo.behaviors.models.idm_profile import IdmParameters, IdmProfile
from scex_sumo.derived import derived
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Plan, SceneHistory, Who

HABIT_STEPS = 5  # of the seed scene's history, over which the acceleration is measured
CURVE_TIME_S = 0.8  # a driver slows down for a curve with this time constant, never harder than ``b``


def idm_acceleration(
    profile: IdmProfile | IdmParameters,
    speed: FloatArray,
    desired_speed: FloatArray,
    gap: FloatArray,
    leader_speed: FloatArray,
) -> FloatArray:
    """Acceleration of the Intelligent Driver Model.

    a = a_max·(1 - (v/v0)⁴ - (s*/s)²), s* = s0 + max(0, v·T + v·Δv / (2·√(a_max·b))), not below
    -max_deceleration. A gap below 0.1 m counts as 0.1 m. Below v0 = 0.1 m/s the driver does not accelerate.

    Args:
        profile: the driver.
        speed: (n,) v, m/s.
        desired_speed: (n,) v0, m/s.
        gap: (n,) s, bumper to bumper, m; inf without a leader.
        leader_speed: (n,) m/s along the path; Δv is own minus leader's.

    Returns:
        (n,) m/s².

    Source: Treiber, Hennecke, Helbing 2000; the lower bound on s* from Treiber and Kesting 2013.
    """
    a_max = profile.max_acceleration
    result: FloatArray = a_max * (
        free_share(speed, desired_speed) - leader_share(profile, speed, gap, leader_speed)
    )
    return np.maximum(result, -profile.max_deceleration)


def free_share(speed: FloatArray, desired_speed: FloatArray) -> FloatArray:
    """(n,) of a_max with which a driver without a leader accelerates: 1 - (v/v0)⁴."""
    free = 1 - (speed / np.maximum(desired_speed, 0.1)) ** 4
    return np.where(desired_speed < 0.1, np.minimum(free, 0.0), free)


def leader_share(
    profile: IdmProfile | IdmParameters, speed: FloatArray, gap: FloatArray, leader_speed: FloatArray
) -> FloatArray:
    """(n,) of a_max that a leader takes from that: (s*/s)²."""
    braking = (
        speed
        * (speed - leader_speed)
        / (2 * np.sqrt(profile.max_acceleration * profile.comfort_deceleration))
    )
    wanted = profile.minimum_gap + np.maximum(speed * profile.time_headway + braking, 0.0)
    share: FloatArray = (wanted / np.maximum(gap, 0.1)) ** 2
    return share


class IdmDriver:
    """Follows its path at the desired speed and keeps its distance to the leader on it.

    The leader is found once per plan and expected to keep its speed along the path.
    """

    def __init__(self, profile: IdmProfile) -> None:
        self.profile = profile

    @property
    def sight(self) -> Sight | None:
        """What decides on a plan; a path that is drawn differs between children."""
        return None if self.profile.path == "random" else "everyone"

    def plan(self, history: SceneHistory, road: Road, who: Who, rng: Sequence[np.random.Generator]) -> Plan:
        """Plan 3 s; see `Behavior.plan`. Draws nothing."""
        return driven(history, [self.intend(history, road, who)])[0]

    def intend(self, history: SceneHistory, road: Road, who: Who) -> Intent:
        """See `DrivesAlong`."""
        return self.follow(history, who, *chosen_paths(history, road, who, self.profile.path))

    def follow(self, history: SceneHistory, who: Who, paths: SeedPaths, row: IntArray) -> Intent:
        """The drive along given paths: (n,) rows of `paths`."""
        profile = self.profile
        own = history.now[who.child, who.vehicle]
        s_centre, _, _ = foot_points(paths, row, own.x, own.y, expected_way(history, who))
        leaders = find_leaders(
            history,
            who,
            paths,
            row,
            s_centre,
            clearance=profile.clearance,
            radius=profile.radius,
            obstacle_clearance=profile.obstacle_clearance,
        )
        # Many children differ somewhere else only: who has the same leader at the same gap drives the same.
        seen = np.stack([row, leaders.gap, leaders.speed], axis=1)
        first, kind = distinct(np.concatenate([own_motion(history, who), seen], axis=1))
        some = Who(child=who.child[first], vehicle=who.vehicle[first])
        behind = (leaders.gap[first], leaders.speed[first])
        accelerate = self._accelerate(history, some, paths, row[first], *behind)
        return Intent(who=some, paths=paths, row=row[first], accelerate=accelerate, kind=kind)

    def _accelerate(
        self,
        history: SceneHistory,
        who: Who,
        paths: SeedPaths,
        row: IntArray,
        leader_gap: FloatArray,
        leader_speed: FloatArray,
    ) -> Accelerate:
        """Behind leaders that keep their speeds: (n,) gaps in m and speeds along the path in m/s."""
        profile = self.profile
        wished = desired_speeds(paths, profile.speed, profile.speed_factor)
        curves = (
            curve_speeds(paths, profile.curve_acceleration, profile.curve_deceleration)
            if profile.curve_acceleration > 0
            else None
        )
        habit = seed_motion(history, who)
        base, last = row * paths.samples, paths.samples - 1.0
        # The centre's place: it is the rear axle that follows the table.
        ahead = REAR_AXLE_SHARE * history.scene.length[who.vehicle]

        def at(s: FloatArray) -> IntArray:
            return base + clipped((s + ahead) * (1 / DS_M), 0.0, last).astype(np.int64)

        def accelerate(step: int, v: FloatArray, travelled: FloatArray, s: FloatArray) -> FloatArray:
            gap = leader_gap + leader_speed * (step * STEP_S) - travelled
            time_s = (history.step + step) * STEP_S
            desired = desired_speed(profile, wished[at(s)], v, *habit, time_s)
            a = idm_acceleration(profile, v, desired, gap, leader_speed)
            if curves is not None:
                # The speed to have where the car will be in a moment, so that it does not lag behind.
                slowing = (curves[at(s + v * CURVE_TIME_S)] - v) / CURVE_TIME_S
                a = np.minimum(a, np.maximum(slowing, -profile.comfort_deceleration))
            return a

        return accelerate


def seed_motion(history: SceneHistory, who: Who) -> tuple[FloatArray, FloatArray]:
    """(n,) speed in the seed scene, m/s, and mean acceleration over the half second before it, m/s²."""
    speed = history.scene.history.speed[who.vehicle]
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
    """Desired speed of drivers who keep to what they showed in the seed scene for a while.

    v0(t) = w + (h - w)·exp(-t/τ), h = v + k·a + m, not below 0 and not above the larger of w and v; w the
    wished speed, v and a speed and acceleration in the seed scene, k the lead, m the margin, τ the memory.
    v0 is never so far below the present speed that the driver would brake with more than b for it alone.

    Args:
        profile: the driver.
        wished: (n,) w, m/s.
        present: (n,) speed at that time, m/s.
        speed: (n,) v, m/s.
        acceleration: (n,) a, m/s².
        time_s: t, since the seed scene.
    """
    if profile.habit_memory == 0:
        return wished
    shown = clipped(
        speed + profile.habit_lead * acceleration + profile.habit_margin, 0.0, np.maximum(wished, speed)
    )
    desired = wished + (shown - wished) * np.exp(-time_s / profile.habit_memory)
    gentle = (1 + profile.comfort_deceleration / profile.max_acceleration) ** -0.25
    bounded: FloatArray = np.maximum(desired, gentle * present)
    return bounded


@derived
def desired_speeds(paths: SeedPaths, speed: float, factor: float) -> FloatArray:
    """(P * N,) desired speed along all paths, m/s: the speed limit times a factor, or a given speed."""
    wished = np.full_like(paths.speed_limit, speed) if speed > 0 else factor * paths.speed_limit
    # A vehicle off the mapped lanes keeps its own speed, whatever the driver wishes.
    off = np.repeat(~paths.on_road, paths.count)
    return np.where(off[:, None], paths.speed_limit, wished).ravel()
