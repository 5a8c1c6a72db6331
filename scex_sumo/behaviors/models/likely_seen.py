"""What a seed scene shows of its drivers: what `LikelyDriver` conditions its draws on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import Leaders, find_leaders
from scex_sumo.behaviors.driving.motion import curve_speeds, rear_axle
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths
from scex_sumo.behaviors.driving.projection import foot_points
from scex_sumo.behaviors.models.idm import (
    CALIBRATED,
    CURVE_TIME_S,
    HABIT_STEPS,
    IdmParameters,
    idm_acceleration,
)
from scex_sumo.behaviors.models.population import FAR_M, MOST_ASIDE_M, Population
from scex_sumo.derived import derived
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, Who

STANDING_MPS = 0.5
CALM_MPS2 = 0.7  # accelerations that scatter this much around their mean tell half
CLEARANCE_M = 1.2  # of another vehicle's centre from the line that a driver keeps to
MARGIN_M = -0.2  # measured boxes of who drives beside a vehicle may touch its own
QUEUE_M = 15.0  # a leader nearer than this holds a standing vehicle


def queue_place(gap_m: FloatArray, leader_speed_mps: FloatArray) -> IntArray:
    """(n,) 0 behind a standing leader, 1 behind one that moves, 2 where no leader is near."""
    near = gap_m < QUEUE_M
    return np.where(near, np.where(np.abs(leader_speed_mps) < STANDING_MPS, 0, 1), 2)


def leaders_of(
    history: SceneHistory, who: Who, paths: SeedPaths, row: IntArray, s: FloatArray, aside: FloatArray
) -> Leaders:
    """Leaders along paths as ``calibrated_driver`` sees them, of vehicles beside them; see `find_leaders`."""
    return find_leaders(
        history,
        who,
        paths,
        row,
        s,
        clearance=CLEARANCE_M,
        radius=CALIBRATED.radius,
        obstacle_clearance=CALIBRATED.obstacle_clearance,
        aside=aside,
        margin=MARGIN_M,
    )


def asked_acceleration(
    profile: IdmParameters,
    speed: FloatArray,
    desired_speed: FloatArray,
    gap: FloatArray,
    leader_speed: FloatArray,
    curve_speed: FloatArray,
) -> FloatArray:
    """(n,) acceleration that the situation asks of a driver: the least of free road, leader and curve.

    The sum of the first two, as in the Intelligent Driver Model, makes who keeps to its speed behind a leader
    fall back from it; people keep their distance.

    Args:
        profile: the drivers.
        speed: (n,) m/s.
        desired_speed: (n,) m/s.
        gap: (n,) to the leader, bumper to bumper, m.
        leader_speed: (n,) m/s along the path.
        curve_speed: (n,) what the curves ahead allow where the vehicle will be in a moment, m/s.

    Source: the least of both, Treiber and Kesting 2013, section 11.3.
    """
    free = idm_acceleration(profile, speed, desired_speed, np.full_like(gap, np.inf), leader_speed)
    following = idm_acceleration(profile, speed, np.full_like(gap, np.inf), gap, leader_speed)
    slowing = np.maximum((curve_speed - speed) / CURVE_TIME_S, -profile.comfort_deceleration)
    return np.minimum(np.minimum(free, following), slowing)


@dataclass(frozen=True, kw_only=True, eq=False)
class LastSecond:
    """What the last second of each vehicle shows, (V,).

    Attributes:
        speed: now, m/s.
        acceleration: m/s², the less the more its single steps scatter: then it is mostly noise.
        scatter: of the accelerations of single steps around that of the whole second, m/s².
        lag: speed that a straight line through the second has now, less the speed now, m/s.
    """

    speed: FloatArray
    acceleration: FloatArray
    scatter: FloatArray
    lag: FloatArray


@derived
def shown_by(scene: SeedScene) -> LastSecond:
    """What the last second of a seed scene shows of its vehicles."""
    speed = scene.history.speed
    time = STEP_S * (np.arange(speed.shape[1]) - (speed.shape[1] - 1) / 2)
    slope = speed @ time / (time @ time)
    late = (speed[:, -1] - speed[:, -1 - HABIT_STEPS]) / (HABIT_STEPS * STEP_S)
    scatter = np.sqrt(((np.diff(speed, axis=1) / STEP_S - slope[:, None]) ** 2).mean(axis=1))
    calm = 1 / (1 + (scatter / CALM_MPS2) ** 2)
    now = np.maximum(speed[:, -1], 0.0)
    line = speed.mean(axis=1) + slope * time[-1]
    return LastSecond(
        speed=now, acceleration=calm * (calm * late + (1 - calm) * slope), scatter=scatter, lag=line - now
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What the seed scene shows along each path, (P,).

    Attributes:
        headway: time headway to the leader on that path, s; inf without one.
        offset: of the rear axle from the path, left positive, m, within `MOST_ASIDE_M`.
        features: (P, 7) what own accelerations depend on: 1, the acceleration shown, what the leader asks
            for, speed difference to it, the lag shown, the leader's acceleration, speed below the limit.
        unsure: (P, 3) what their spread depends on: scatter, size of the acceleration, leader near or not.
    """

    headway: FloatArray
    offset: FloatArray
    features: FloatArray
    unsure: FloatArray


@derived
def seen_of(scene: SeedScene, paths: SeedPaths) -> Seen:
    """What a seed scene shows of every vehicle along each of its paths."""
    history = SceneHistory.of_scene(scene)
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row, shown = np.arange(len(vehicle)), shown_by(scene)
    who = Who(child=np.zeros_like(vehicle), vehicle=vehicle)
    now, begin = scene.now[vehicle], np.full(len(vehicle), BEHIND_M)
    x, y = rear_axle(now, scene.length[vehicle])
    offset = np.clip(foot_points(paths, row, x, y, begin)[1], -MOST_ASIDE_M, MOST_ASIDE_M)
    s, _, _ = foot_points(paths, row, now.x, now.y, begin)
    leaders = leaders_of(history, who, paths, row, s, offset)
    speed, acceleration = shown.speed[vehicle], shown.acceleration[vehicle]
    free = np.full_like(speed, np.inf)
    following = idm_acceleration(CALIBRATED, speed, free, leaders.gap, leaders.speed)
    near = leaders.gap < FAR_M
    opening = np.where(near, leaders.speed - speed, 0.0)
    limits = (
        (acceleration, -4.0, 4.0),
        (following, -4.0, 1.6),
        (opening, -8.0, 8.0),
        (shown.lag[vehicle], -2.0, 2.0),
        (_of_leader(leaders, near, shown.acceleration), -3.0, 3.0),
        (paths.speed_limit[row, int((BEHIND_M + 10.0) / DS_M)] - speed, -5.0, 10.0),
    )
    return Seen(
        headway=leaders.gap / np.maximum(speed, 1.0),
        offset=offset,
        features=np.column_stack([np.ones_like(speed), *(np.clip(*values) for values in limits)]),
        unsure=np.column_stack(
            [np.log1p(shown.scatter[vehicle]), np.minimum(np.abs(acceleration), 4.0), near.astype(np.float64)]
        ),
    )


def _of_leader(leaders: Leaders, near: BoolArray, values: FloatArray) -> FloatArray:
    """(P,) a value of each path's leader, of (V,) values; 0 where it is not near, or no vehicle."""
    known = near & (leaders.index >= 0) & (leaders.index < len(values))
    return np.where(known, values[np.where(known, leaders.index, 0)], 0.0)


def path_features(scene: SeedScene, paths: SeedPaths) -> FloatArray:
    """(P, 4) how each path fits what the seed scene shows of its vehicle.

    Speed above that from which the path's curves are comfortable, m/s; offset of the centre, m; heading off
    the path, rad; and 1 where it is not the straight one.
    """
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row = np.arange(len(vehicle))
    now = scene.now[vehicle]
    s, offset, heading = foot_points(paths, row, now.x, now.y, np.full(len(row), BEHIND_M))
    calm = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    at = row * paths.samples + np.clip(s / DS_M, 0, paths.samples - 1).astype(np.int64)
    excess = np.maximum(now.speed - calm[at], 0.0)
    across = np.abs(wrap(now.heading - heading))
    other = row != paths.first[vehicle] + paths.straight[vehicle]
    return np.column_stack([excess, np.abs(offset), across, other.astype(np.float64)])


@derived
def path_edges(scene: SeedScene, paths: SeedPaths, known: Population) -> FloatArray:
    """(P,) upper edge in [0, 1] of each path's share of a vehicle's draw."""
    share = np.diff(paths.draw_edges, prepend=0.0)
    share[paths.first] = paths.draw_edges[paths.first]
    weight = np.maximum(share, 1e-9) * np.exp(-path_features(scene, paths) @ known.path) + 1e-12
    edges = np.empty_like(weight)
    for first, count in zip(paths.first, paths.count, strict=True):
        part = slice(first, first + count)
        edges[part] = np.cumsum(weight[part]) / weight[part].sum()
    return edges
