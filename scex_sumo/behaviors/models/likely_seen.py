"""What a seed scene shows of its drivers: what `LikelyDriver` conditions its draws on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import Leaders, find_leaders
from scex_sumo.behaviors.driving.motion import curve_speeds, rear_axle
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths
from scex_sumo.behaviors.driving.projection import bend_at, foot_points
from scex_sumo.behaviors.models.idm import (
    CURVE_TIME_S,
    HABIT_STEPS,
    desired_speeds,
    free_share,
    idm_acceleration,
    leader_share,
)
from scex_sumo.behaviors.models.idm_profile import CALIBRATED, IdmParameters
from scex_sumo.behaviors.models.population import FAR_M, MOST_ASIDE_M, Population
from scex_sumo.derived import derived
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, Who

STANDING_MPS = 0.5
CALM_MPS2 = 0.7  # accelerations that scatter this much around their mean tell half
MOST_SCATTER_MPS2 = 0.7  # beyond this, scatter says no more of a driver
CLEARANCE_M = 1.2  # of another vehicle's centre from the line that a driver keeps to
MOST_SWERVE = 1.5  # m/s and m/s² across a path that are believed
MARGIN_M = -0.2  # measured boxes of who drives beside a vehicle may touch its own
BESIDE_M = 8.0  # who is this near in front or behind, and beside the way, drives beside
WIDE_M = 3.0  # more room beside a vehicle makes no difference
FAST_MPS = 20.0  # nor does a higher speed
QUEUE_M = 15.0  # a leader nearer than this holds a standing vehicle
COUPLED_M = 2.0  # who drives nearer to its leader than this, as fast as it, is taken to keep this distance
COUPLED_MPS = (3.0, 5.0)  # at this speed and difference of speed, at least and at most
MOST_SLACK_M = 4.0
HASTE_MPS2 = 1.6  # nobody brakes for a leader harder than it takes, and by this much: set by CRPS
LEAST_ROOM_M = 0.1


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
    fall back from it; people keep their distance. Nor do they brake harder than it takes to be as slow as the
    leader at the least gap, but for `HASTE_MPS2`. Before curves they brake as ``calibrated_driver`` does.

    Args:
        profile: the drivers.
        speed: (n,) m/s.
        desired_speed: (n,) m/s.
        gap: (n,) to the leader, bumper to bumper, m.
        leader_speed: (n,) m/s along the path.
        curve_speed: (n,) what the curves ahead allow where the vehicle will be in a moment, m/s.

    Source: the least of both, Treiber and Kesting 2013, section 11.3; what it takes, Kesting et al. 2010.
    """
    free = profile.max_acceleration * free_share(speed, desired_speed)
    following = profile.max_acceleration * (1 - leader_share(profile, speed, gap, leader_speed))
    room = np.maximum(gap - profile.minimum_gap, LEAST_ROOM_M)
    needed = -(np.maximum(speed - leader_speed, 0.0) ** 2) / (2 * room)
    beyond = np.maximum(needed - following, 0.0)
    following += beyond - HASTE_MPS2 * np.tanh(beyond / HASTE_MPS2)
    slowing = np.maximum((curve_speed - speed) / CURVE_TIME_S, -CALIBRATED.comfort_deceleration)
    return np.minimum(np.maximum(np.minimum(free, following), -profile.max_deceleration), slowing)


@dataclass(frozen=True, kw_only=True, eq=False)
class LastSecond:
    """What the last second of each vehicle shows, (V,).

    Attributes:
        speed: now, m/s.
        acceleration: m/s², the less the more its single steps scatter: then it is mostly noise.
        scatter: of the accelerations of single steps around that of the whole second, m/s².
        lag: speed that a straight line through the second has now, less the speed now, m/s.
        calm: share of what is shown that is not taken for noise.
    """

    speed: FloatArray
    acceleration: FloatArray
    scatter: FloatArray
    lag: FloatArray
    calm: FloatArray


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
        speed=now,
        acceleration=calm * (calm * late + (1 - calm) * slope),
        scatter=scatter,
        lag=line - now,
        calm=calm,
    )


@derived
def room_beside(scene: SeedScene) -> FloatArray:
    """(V, 2) free room to the right and to the left of each vehicle, to those who drive beside it, m."""
    now, far = scene.now, scene.length[:, None] / 2 + scene.length / 2 + BESIDE_M
    cos, sin = np.cos(now.heading)[:, None], np.sin(now.heading)[:, None]
    dx, dy = now.x - now.x[:, None], now.y - now.y[:, None]
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    turn = now.heading - now.heading[:, None]
    half = (np.abs(np.sin(turn)) * scene.length + np.abs(np.cos(turn)) * scene.width) / 2
    gap = np.abs(left) - half - scene.width[:, None] / 2
    beside = (np.abs(ahead) < far) & ((gap > 0) | (np.abs(ahead) < far - BESIDE_M))
    np.fill_diagonal(beside, False)
    gap = np.maximum(gap, 0.0)
    near = (np.where(beside & side, gap, np.inf) for side in (left < 0, left > 0))
    return np.stack([each.min(axis=1, initial=np.inf) for each in near], axis=1)


@derived
def side_shown(scene: SeedScene) -> FloatArray:
    """(V, 3) what the spread of places beside the path depends on: scatter, speed, least room beside."""
    shown = shown_by(scene)
    room = np.minimum(room_beside(scene).min(axis=1), WIDE_M)
    return np.column_stack([_capped(shown.scatter), np.minimum(shown.speed, FAST_MPS) / FAST_MPS, room])


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What the seed scene shows along each path, (P,).

    Attributes:
        leader: column of the leader on that path, as in `Leaders`; -1 without one.
        slack: by how much further away than its box it is taken to be, m: trailers that were recorded as
            vehicles, boxes that are too long, and those who drive side by side are not to brake for it.
        gap: to the leader, with its slack, m; inf without one.
        leader_speed: m/s along the path.
        wished: speed that the driver wishes, m/s.
        curve: speed that the curves ahead allow where the vehicle will be in a moment, m/s.
        headway: time headway to the leader, beyond the least gap, s; inf without one.
        across: (P, 3) of the rear axle: offset from the path, left positive, m, within `MOST_ASIDE_M`; speed
            across it, m/s; and how that changes, m/s².
        features: (P, 7) what own accelerations depend on: 1, the acceleration shown, what the leader asks
            for, speed difference to it, the lag shown, the leader's acceleration, speed below the limit.
        unsure: (P, 3) what their spread depends on: scatter, size of the acceleration, leader near or not.
    """

    leader: IntArray
    slack: FloatArray
    gap: FloatArray
    leader_speed: FloatArray
    wished: FloatArray
    curve: FloatArray
    headway: FloatArray
    across: FloatArray
    features: FloatArray
    unsure: FloatArray


@derived
def seen_of(scene: SeedScene, paths: SeedPaths) -> Seen:
    """What a seed scene shows of every vehicle along each of its paths."""
    history = SceneHistory.of_scene(scene)
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row, shown = np.arange(len(vehicle)), shown_by(scene)
    who = Who(child=np.zeros_like(vehicle), vehicle=vehicle)
    now, across = scene.now[vehicle], _across(scene, paths, vehicle, row)
    s, _, _ = foot_points(paths, row, now.x, now.y, np.full(len(row), BEHIND_M))
    leaders = leaders_of(history, who, paths, row, s, across[:, 0])
    speed, acceleration = shown.speed[vehicle], shown.acceleration[vehicle]
    free = np.full_like(speed, np.inf)
    opening = leaders.speed - speed
    coupled = (speed > COUPLED_MPS[0]) & (np.abs(opening) < COUPLED_MPS[1])
    slack = np.where(coupled, np.clip(COUPLED_M - leaders.gap, 0.0, MOST_SLACK_M), 0.0)
    gap = leaders.gap + slack
    following = idm_acceleration(CALIBRATED, speed, free, gap, leaders.speed)
    near = leaders.gap < FAR_M
    opening = np.where(near, opening, 0.0)
    limits = (
        (acceleration, -4.0, 4.0),
        (following, -4.0, 1.6),
        (opening, -8.0, 8.0),
        (shown.lag[vehicle], -2.0, 2.0),
        (_of_leader(leaders, near, shown.acceleration), -3.0, 3.0),
        (paths.speed_limit[row, int((BEHIND_M + 10.0) / DS_M)] - speed, -5.0, 10.0),
    )
    scatter = _capped(shown.scatter[vehicle])
    first, last = row * paths.samples, paths.samples - 1

    def at(s: FloatArray) -> IntArray:
        return first + np.clip(s / DS_M, 0, last).astype(np.int64)

    curves = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    return Seen(
        leader=leaders.index,
        slack=slack,
        gap=gap,
        leader_speed=leaders.speed,
        wished=desired_speeds(paths, CALIBRATED.speed, CALIBRATED.speed_factor)[at(s)],
        curve=curves[at(s + speed * CURVE_TIME_S)],
        headway=(gap - CALIBRATED.minimum_gap) / np.maximum(speed, 1.0),
        across=across,
        features=np.column_stack([np.ones_like(speed), *(np.clip(*values) for values in limits)]),
        unsure=np.column_stack([scatter, np.minimum(np.abs(acceleration), 4.0), near.astype(np.float64)]),
    )


def _across(scene: SeedScene, paths: SeedPaths, vehicle: IntArray, row: IntArray) -> FloatArray:
    """(P, 3) motion of rear axles across their paths, as in `Seen`."""
    now, speed = scene.now[vehicle], shown_by(scene).speed[vehicle]
    x, y = rear_axle(now, scene.length[vehicle])
    s, offset, along = foot_points(paths, row, x, y, np.full(len(row), BEHIND_M))
    before = scene.history[vehicle, -1 - HABIT_STEPS].heading
    turn_rate = wrap(now.heading - before) / (HABIT_STEPS * STEP_S)
    swerve = speed * np.sin(now.heading - along)
    turning = speed * (turn_rate - speed * bend_at(paths, row, s))
    most = np.array([MOST_ASIDE_M, MOST_SWERVE, MOST_SWERVE])
    across: FloatArray = np.clip(np.column_stack([offset, swerve, turning]), -most, most)
    return across


def _capped(scatter: FloatArray) -> FloatArray:
    return np.minimum(scatter, MOST_SCATTER_MPS2)


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
