"""Observations of drivers in a seed scene, on which `LikelyDriver` conditions its draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.behaviors.driving.beside import box_distances
from scex_sumo.behaviors.driving.leaders import Leaders, find_ahead
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S, curve_speeds, rear_axle
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths
from scex_sumo.behaviors.driving.projection import bend_at, foot_points
from scex_sumo.behaviors.models.idm import (
    CALIBRATED,
    HABIT_STEPS,
    IdmParameters,
    desired_speeds,
    free_share,
    idm_acceleration,
    leader_share,
)
from scex_sumo.geometry.polylines import wrap
from scex_sumo.humans.population import FAR_M, MAX_ASIDE_M, Population
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

STANDING_MPS = 0.5
CREEPING_MPS = 3.0  # a slower vehicle that does not stand may come to rest
HALF_TRUST_MPS2 = 0.7  # scatter of accelerations at which a measured one counts by half
MAX_SCATTER_MPS2 = 0.7
LASTING_MPS2, LARGE_MPS2 = 0.5, 1.0  # shown accelerations count by at most LARGE² / hypot(scatter, LASTING)
NOISY_MPS2 = 0.1  # noise of accelerations of single steps at which the last one counts by half
CLEARANCE_M = 1.2  # of another vehicle's centre from the line that a driver keeps
MAX_LATERAL = 1.5  # m/s and m/s² across a path; larger values are errors of measurement
MARGIN_M = -0.2  # measured boxes of vehicles side by side may touch
BESIDE_M = 8.0  # along the way; a nearer vehicle next to the way is beside
MAX_ROOM_M = 3.0  # more room beside a vehicle makes no difference
MAX_SPEED_MPS = 20.0  # nor does a higher speed
MOVING_OFF_MPS2, WAVE_MPS = 2.4, 3.0  # largest acceleration and speed of a vehicle that leaves a queue
QUEUE_M = 15.0  # a leader nearer than this holds a standing vehicle
COUPLED_M = 2.0  # least gap assumed between a vehicle and a leader at the same speed
COUPLED_MPS = (3.0, 5.0)  # at least this speed, and at most this difference
MAX_SLACK_M = 4.0
TRACKED_TWICE_M, APART_M = 1.0, 1000.0  # overlap of two boxes along the way, and the slack for it
EXTRA_BRAKING_MPS2 = 0.8  # limit beyond the necessary braking for a leader; set by CRPS
MIN_ROOM_M = 0.1
AROUND_M = 30.0  # vehicles around count by exp(-distance / AROUND_M), and together less than 1
DOUBT_AROUND = 0.5  # weight of no acceleration among theirs
ALONG = 0.5  # cosine of the heading against the path; below it, a vehicle crosses
CLEAR_S = 1.0  # by which it has to leave earlier
TURN_MPS2, TURN_M, NEAR_TURN_M = 3.0, 50.0, 2.0  # lateral acceleration in turns; range of the way to them
MAX_MISSING_MPS2 = 2.0  # more missing braking excludes a path no further
SAME_WAY = 0.8  # cosine of the difference of headings


def start_features(
    speed_mps: FloatArray, gap_m: FloatArray, leader_speed_mps: FloatArray, wave: BoolArray
) -> FloatArray:
    """Return (n, 5) features of the rate of starting.

    1; creeping speed over `STANDING_MPS`; near leader moves off; no near leader; near leader stands behind
    one that moves off (``wave``). A leader that cannot have stood in the queue does not move off: it passes.
    """
    near, stands = gap_m < QUEUE_M, np.abs(leader_speed_mps) <= STANDING_MPS
    moves = ~stands & (leader_speed_mps > 0) & (leader_speed_mps**2 < 2 * MOVING_OFF_MPS2 * gap_m)
    creep = np.clip(speed_mps / STANDING_MPS, 0.0, 1.0)
    return np.column_stack([np.ones_like(gap_m), creep, near & moves, ~near, near & stands & wave])


def stop_features(
    speed_mps: FloatArray, acceleration_mps2: FloatArray, gap_m: FloatArray, leader_speed_mps: FloatArray
) -> FloatArray:
    """Return (n, 5) features of the log odds that a creeping vehicle comes to rest.

    1; speed; shown acceleration; near leader or not; its speed beyond that of the vehicle.
    """
    near = gap_m < QUEUE_M
    opening = np.where(near, np.clip(leader_speed_mps - speed_mps, -CREEPING_MPS, CREEPING_MPS), 0.0)
    return np.column_stack([np.ones_like(speed_mps), speed_mps, acceleration_mps2, near, opening])


@owner_cache
def queue_leaders(scene: SeedScene, paths: SeedPaths) -> IntArray:
    """Return (V,) near leaders on straight paths; -1 without one."""
    observed, row = observations_of(scene, paths), paths.first + paths.straight
    leader = observed.leader[row]
    return np.where((observed.gap[row] < QUEUE_M) & (leader < scene.vehicles), leader, -1)


def behind_a_wave(speed_mps: FloatArray, leaders: Leaders, child: IntArray, queue: IntArray) -> BoolArray:
    """Return (n,) whether the leader's leader moves off.

    Args:
        speed_mps: (C, V) present speeds.
        queue: (V,) as `queue_leaders`.
    """
    first = np.where((leaders.index >= 0) & (leaders.index < len(queue)), leaders.index, 0)
    second = np.where(leaders.index == first, queue[first], -1)
    speed = speed_mps[child, np.maximum(second, 0)]
    return (second >= 0) & (speed > STANDING_MPS) & (speed < WAVE_MPS)


def leaders_of(
    history: SceneHistory,
    who: VehicleIndex,
    paths: SeedPaths,
    row: IntArray,
    s: FloatArray,
    aside: FloatArray,
) -> Leaders:
    """Find leaders of vehicles beside their paths; see `find_ahead`.

    One that crosses and has left before the driver arrives is no leader.
    """
    ahead = find_ahead(
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
    speed = history.now.speed[who.child, who.vehicle][ahead.driver]
    arrives = np.maximum(ahead.gap, 0.0) / np.maximum(speed, STANDING_MPS)
    return ahead.part((ahead.cos >= ALONG) | (ahead.leaves + CLEAR_S > arrives)).leaders(len(who))


def demanded_acceleration(
    profile: IdmParameters,
    speed: FloatArray,
    desired_speed: FloatArray,
    gap: FloatArray,
    leader_speed: FloatArray,
    curve_speed: FloatArray,
) -> FloatArray:
    """Return (n,) accelerations for free road, leader and curve, the least of them, m/s².

    The sum, as in the Intelligent Driver Model, makes drivers at their desired speed fall back. Braking
    exceeds the necessary by at most `EXTRA_BRAKING_MPS2`.

    Args:
        gap: (n,) bumper to bumper, m.
        leader_speed: (n,) m/s along the path.
        curve_speed: (n,) allowed a moment later, m/s.

    Source: minimum, Treiber and Kesting 2013, section 11.3; necessary braking, Kesting et al. 2010.
    """
    free = profile.max_acceleration * free_share(speed, desired_speed)
    following = profile.max_acceleration * (1 - leader_share(profile, speed, gap, leader_speed))
    room = np.maximum(gap - profile.minimum_gap, MIN_ROOM_M)
    needed = -(np.maximum(speed - leader_speed, 0.0) ** 2) / (2 * room)
    excess = np.maximum(needed - following, 0.0)
    following += excess - EXTRA_BRAKING_MPS2 * np.tanh(excess / EXTRA_BRAKING_MPS2)
    slowing = np.maximum((curve_speed - speed) / CURVE_TIME_S, -CALIBRATED.comfort_deceleration)
    return np.minimum(np.maximum(np.minimum(free, following), -profile.max_deceleration), slowing)


@dataclass(frozen=True, kw_only=True, eq=False)
class LastSecond:
    """Motion of each vehicle in the last second, (V,)."""

    speed: FloatArray  # now, m/s
    slope: FloatArray  # acceleration of a straight line through the speeds, m/s²
    late: FloatArray  # mean acceleration of the last `HABIT_STEPS`, m/s²
    acceleration: FloatArray  # that lasts, m/s², reduced by its scatter
    sudden: FloatArray  # present acceleration beyond the lasting one, m/s²
    scatter: FloatArray  # of accelerations of single steps, m/s²
    lag: FloatArray  # present speed of a straight line minus the present speed, m/s
    calm: FloatArray  # share of the acceleration that is not noise


@owner_cache
def last_second(scene: SeedScene) -> LastSecond:
    """Measure the motion in the last second."""
    speed = scene.history.speed
    time = STEP_S * (np.arange(speed.shape[1]) - (speed.shape[1] - 1) / 2)
    slope, single = speed @ time / (time @ time), np.diff(speed, axis=1) / STEP_S
    late = (speed[:, -1] - speed[:, -1 - HABIT_STEPS]) / (HABIT_STEPS * STEP_S)
    scatter = np.sqrt(((single - slope[:, None]) ** 2).mean(axis=1))
    calm = 1 / (1 + (scatter / HALF_TRUST_MPS2) ** 2)
    change = calm * late + (1 - calm) * slope
    # A large one is sooner an error of noisy tracks, and ends sooner on clean ones.
    lasting = change / np.hypot(1.0, change * np.hypot(scatter, LASTING_MPS2) / LARGE_MPS2**2)
    # Second differences of white noise have six times its variance; those of smooth motion are small.
    noise2 = (np.diff(single, n=2, axis=1) ** 2).mean(axis=1) / 6
    now = np.maximum(speed[:, -1], 0.0)
    line = speed.mean(axis=1) + slope * time[-1]
    return LastSecond(
        speed=now,
        slope=slope,
        late=late,
        acceleration=lasting,
        sudden=np.where(now < STANDING_MPS, 0.0, (single[:, -1] - lasting) / (1 + noise2 / NOISY_MPS2**2)),
        scatter=scatter,
        lag=line - now,
        calm=calm,
    )


@owner_cache
def acceleration_around(scene: SeedScene) -> FloatArray:
    """Return (V,) weighted mean accelerations of the other vehicles around that move the same way, m/s²."""
    now = scene.now
    moves = (now.speed > STANDING_MPS) & (np.cos(now.heading - now.heading[:, None]) > SAME_WAY)
    weight = moves * np.exp(-np.hypot(now.x - now.x[:, None], now.y - now.y[:, None]) / AROUND_M)
    np.fill_diagonal(weight, 0.0)
    return np.asarray(weight @ last_second(scene).slope / (weight.sum(axis=1) + DOUBT_AROUND))


@owner_cache
def room_beside(scene: SeedScene) -> FloatArray:
    """Return (V, 2) room to vehicles on the right and left, m."""
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


@owner_cache
def side_shown(scene: SeedScene) -> FloatArray:
    """Return (V, 3) scatter, relative speed and smaller room beside."""
    shown = last_second(scene)
    room = np.minimum(room_beside(scene).min(axis=1), MAX_ROOM_M)
    return np.column_stack(
        [_capped(shown.scatter), np.minimum(shown.speed, MAX_SPEED_MPS) / MAX_SPEED_MPS, room]
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class PathObservations:
    """Observations along each path, (P,)."""

    leader: IntArray  # as in `Leaders`
    slack: FloatArray  # addition to the gap, m, so that trailers and too long boxes do not brake
    gap: FloatArray  # with slack, m; inf without a leader
    leader_speed: FloatArray  # m/s along the path
    wished: FloatArray  # desired speed without habit, m/s
    curve: FloatArray  # speed that the curves ahead allow a moment later, m/s
    headway: FloatArray  # beyond the minimum gap, s
    across: FloatArray  # (P, 3) lateral motion of the rear axle: m, left positive; m/s; m/s²
    # (P, 9) 1, shown acceleration, that of the model, speed difference to the leader, lag, leader's
    # acceleration, limit minus speed, speed difference to the leader's leader, acceleration around
    features: FloatArray
    unsure: FloatArray  # (P, 3) scatter, size of the acceleration, leader near or not


@owner_cache
def observations_of(scene: SeedScene, paths: SeedPaths) -> PathObservations:
    """Observe vehicles along each of their paths."""
    history = SceneHistory.of_scene(scene)
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row, shown = np.arange(len(vehicle)), last_second(scene)
    who = VehicleIndex(child=np.zeros_like(vehicle), vehicle=vehicle)
    now, across = scene.now[vehicle], _across(scene, paths, vehicle, row)
    s, _, _ = foot_points(paths, row, now.x, now.y, np.full(len(row), BEHIND_M))
    leaders = leaders_of(history, who, paths, row, s, across[:, 0])
    speed, acceleration = shown.speed[vehicle], shown.acceleration[vehicle]
    free = np.full_like(speed, np.inf)
    opening = leaders.speed - speed
    coupled = (speed > COUPLED_MPS[0]) & (np.abs(opening) < COUPLED_MPS[1])
    slack = np.where(coupled, np.clip(COUPLED_M - leaders.gap, 0.0, MAX_SLACK_M), 0.0)
    slack[_overlaps(scene, vehicle, leaders)] = APART_M
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
        (_second_opening(scene, paths, leaders, near, shown.speed, speed), -8.0, 8.0),
        (acceleration_around(scene)[vehicle], -3.0, 3.0),
    )
    scatter = _capped(shown.scatter[vehicle])
    first, last = row * paths.samples, paths.samples - 1

    def at(s: FloatArray) -> IntArray:
        return first + np.clip(s / DS_M, 0, last).astype(np.int64)

    curves = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    return PathObservations(
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


def _overlaps(scene: SeedScene, vehicle: IntArray, leaders: Leaders) -> BoolArray:
    """Return (P,) whether the leader is a vehicle tracked twice."""
    known = (leaders.index >= 0) & (leaders.index < scene.vehicles) & (leaders.gap < -TRACKED_TWICE_M)
    at = np.where(known, leaders.index, 0)
    return np.asarray(known & (box_distances(scene)[vehicle, at] <= 0))


def _across(scene: SeedScene, paths: SeedPaths, vehicle: IntArray, row: IntArray) -> FloatArray:
    now, speed = scene.now[vehicle], last_second(scene).speed[vehicle]
    x, y = rear_axle(now, scene.length[vehicle])
    s, offset, along = foot_points(paths, row, x, y, np.full(len(row), BEHIND_M))
    before = scene.history[vehicle, -1 - HABIT_STEPS].heading
    turn_rate = wrap(now.heading - before) / (HABIT_STEPS * STEP_S)
    swerve = speed * np.sin(now.heading - along)
    turning = speed * (turn_rate - speed * bend_at(paths, row, s))
    limit = np.array([MAX_ASIDE_M, MAX_LATERAL, MAX_LATERAL])
    across: FloatArray = np.clip(np.column_stack([offset, swerve, turning]), -limit, limit)
    return across


def _capped(scatter: FloatArray) -> FloatArray:
    return np.minimum(scatter, MAX_SCATTER_MPS2)


def _of_leader(leaders: Leaders, near: BoolArray, values: FloatArray) -> FloatArray:
    """Return (P,) values of near leaders from (V,) values, else 0."""
    is_vehicle = near & (leaders.index >= 0) & (leaders.index < len(values))
    return np.where(is_vehicle, values[np.where(is_vehicle, leaders.index, 0)], 0.0)


def _second_opening(
    scene: SeedScene,
    paths: SeedPaths,
    leaders: Leaders,
    near: BoolArray,
    speeds: FloatArray,
    speed: FloatArray,
) -> FloatArray:
    """Return (P,) speed differences to the near leaders of near leaders, m/s; 0 without."""
    straight = paths.first + paths.straight
    second = np.where(near & (leaders.index < scene.vehicles), leaders.index, -1)[straight]
    there = _of_leader(leaders, near, (second >= 0).astype(np.float64))
    return there * (_of_leader(leaders, near, speeds[second]) - speed)


def path_features(scene: SeedScene, paths: SeedPaths) -> FloatArray:
    """Return (P, 4) features: missing braking, m/s², excessive speed, m/s, offset, m, heading error, rad.

    A vehicle that is about to turn slows down: braking is missing as far as the curves within `TURN_M` need
    more than it shows. A speed is excessive if even hard braking and sharp curves do not bring it down.
    """
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row, shown = np.arange(len(vehicle)), last_second(scene)
    now, speed = scene.now[vehicle], shown.speed[vehicle]
    s, offset, heading = foot_points(paths, row, now.x, now.y, np.full(len(row), BEHIND_M))
    ahead = DS_M * np.arange(paths.samples) - s[:, None]
    excess = speed[:, None] ** 2 - TURN_MPS2 / np.maximum(paths.curve_curvature, 1e-6)
    needed = np.where(np.abs(ahead - TURN_M / 2) < TURN_M / 2, excess, 0.0) / (
        2 * np.maximum(ahead, NEAR_TURN_M)
    )
    needed = np.maximum(needed.max(axis=1), 0.0)
    missing = np.where(needed > 0, needed + np.clip(shown.acceleration[vehicle], -3.0, 2.0), 0.0)
    calm = curve_speeds(paths, CALIBRATED.curve_acceleration, CALIBRATED.curve_deceleration)
    at = row * paths.samples + np.clip(s / DS_M, 0, paths.samples - 1).astype(np.int64)
    return np.column_stack(
        [
            np.clip(missing, 0.0, MAX_MISSING_MPS2),
            np.maximum(now.speed - calm[at], 0.0),
            np.abs(offset),
            np.abs(wrap(now.heading - heading)),
        ]
    )


@owner_cache
def path_weights(scene: SeedScene, paths: SeedPaths, people: Population) -> FloatArray:
    """Return (P,) relative probabilities, above 0, of each vehicle's paths."""
    share = np.diff(paths.draw_edges, prepend=0.0)
    share[paths.first] = paths.draw_edges[paths.first]
    return np.asarray(np.maximum(share, 1e-9) * np.exp(-path_features(scene, paths) @ people.path) + 1e-12)


def path_edges(scene: SeedScene, paths: SeedPaths, people: Population) -> FloatArray:
    """Return (P,) upper edges in [0, 1] of paths' shares of a draw."""
    weight = path_weights(scene, paths, people)
    edges = np.empty_like(weight)
    for first, count in zip(paths.first, paths.count, strict=True):
        part = slice(first, first + count)
        edges[part] = np.cumsum(weight[part]) / weight[part].sum()
    return edges
