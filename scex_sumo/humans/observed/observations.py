"""Observations of drivers in a seed scene, on which `LikelyDriver` conditions its draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.leaders import Leaders, find_ahead
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S, curve_speeds, rear_axle
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, OnPath, SeedPaths, upper_edges
from scex_sumo.behaviors.models.idm import HABIT_STEPS, desired_speeds, idm_acceleration
from scex_sumo.geometry.polylines import wrap
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

CLEAR_M = 1.4  # of the line from the bounds of its lanes
LEADER_MOVES = 2  # column of `start_features`


def start_features(
    speed: FloatArray, gap: FloatArray, leader_speed: FloatArray, wave: BoolArray, human: HumanParameters
) -> FloatArray:
    """Return (n, 5) features of the rate of starting.

    1; creeping speed over that of standing; near leader moves off; no near leader; near leader stands behind
    one that moves off (``wave``). A leader that cannot have stood in the queue does not move off: it passes.
    """
    near, stands = gap < human.queue_m, np.abs(leader_speed) <= human.standing_mps
    moves = ~stands & (leader_speed > 0) & (leader_speed**2 < 2 * human.queue_start_mps2 * gap)
    creep = np.clip(speed / human.standing_mps, 0.0, 1.0)
    return np.column_stack([np.ones_like(gap), creep, near & moves, ~near, near & stands & wave])


def kept_headway(gap: FloatArray, speed: FloatArray, human: HumanParameters) -> FloatArray:
    """Return (n,) headways beyond the gap at rest that drivers keep at shown gaps, s."""
    beyond = np.maximum(gap - human.rest_m, 0.0)
    return np.asarray(human.headway_kept * beyond / np.maximum(speed, 1.0))


@owner_cache
def queue_leaders(scene: SeedScene, paths: SeedPaths, human: HumanParameters) -> IntArray:
    """Return (V,) near leaders on straight paths; -1 without one."""
    observed, row = observations_of(scene, paths, human), paths.first + paths.straight
    leader = observed.leader[row]
    return np.where((observed.gap[row] < human.queue_m) & (leader < scene.vehicles), leader, -1)


def behind_a_wave(
    speed_mps: FloatArray, leaders: Leaders, future: IntArray, queue: IntArray, human: HumanParameters
) -> BoolArray:
    """Return (n,) whether the leader's leader, of `queue_leaders` (V,), moves off; speeds (C, V)."""
    first = np.where((leaders.index >= 0) & (leaders.index < len(queue)), leaders.index, 0)
    second = np.where(leaders.index == first, queue[first], -1)
    speed = speed_mps[future, np.maximum(second, 0)]
    return (second >= 0) & (speed > human.standing_mps) & (speed < human.queue_start_mps)


class View(NamedTuple):
    """n vehicles on their paths when they plan."""

    history: SceneHistory
    vehicles: VehicleIndex
    paths: SeedPaths
    row: IntArray  # (n,) path of each vehicle
    s: FloatArray  # (n,) place of its centre on that path, m
    human: HumanParameters

    @property
    def scene(self) -> SeedScene:
        """Return the seed scene."""
        return self.history.scene

    @property
    def on_path(self) -> OnPath:
        """Return the vehicles and their paths."""
        return OnPath(self.history, self.vehicles, self.paths, self.row)

    @property
    def observed(self) -> PathObservations:
        """Return what each path shows in the seed scene."""
        return observations_of(self.scene, self.paths, self.human)

    @property
    def shown(self) -> LastSecond:
        """Return what the last second before the seed scene shows."""
        return last_second(self.scene, self.human)


def leaders_of(view: View, aside: FloatArray) -> Leaders:
    """Find leaders at offsets from paths (n,), m; one that crosses and has left in time is none."""
    history, vehicles, paths, row, s, human = view
    ahead = find_ahead(
        *(history, vehicles, paths, row, s),
        clearance=human.clearance_m,
        radius=human.idm.radius,
        aside=aside,
        margin=human.corridor_margin_m,
    )
    speed = history.now.speed[vehicles.future, vehicles.vehicle][ahead.driver]
    arrives = np.maximum(ahead.gap, 0.0) / np.maximum(speed, human.standing_mps)
    stays = ahead.leaves + human.clear_s > arrives
    return ahead.take((ahead.cos >= human.along_cos) | stays).leaders(len(vehicles))


class LastSecond(NamedTuple):
    """Motion of each vehicle in the last second, (V,)."""

    speed: FloatArray  # now, m/s
    slope: FloatArray  # acceleration of a straight line through the speeds, m/s²
    recent: FloatArray  # mean acceleration of the last `HABIT_STEPS`, m/s²
    acceleration: FloatArray  # that lasts, m/s², reduced by its scatter
    sudden: FloatArray  # present acceleration beyond the lasting one, m/s²
    scatter: FloatArray  # of accelerations of single steps, m/s²
    line_error: FloatArray  # present speed of a straight line minus the present speed, m/s
    trust: FloatArray  # share of the acceleration that is not noise
    turn_rate: FloatArray  # mean of the last `HABIT_STEPS`, rad/s


@owner_cache
def last_second(scene: SeedScene, human: HumanParameters) -> LastSecond:
    """Measure the motion in the last second."""
    speed, heading = scene.history.speed, scene.history.heading
    time = STEP_S * (np.arange(speed.shape[1]) - (speed.shape[1] - 1) / 2)
    slope, single = speed @ time / (time @ time), np.diff(speed, axis=1) / STEP_S
    recent = (speed[:, -1] - speed[:, -1 - HABIT_STEPS]) / (HABIT_STEPS * STEP_S)
    turn_rate = wrap(heading[:, -1] - heading[:, -1 - HABIT_STEPS]) / (HABIT_STEPS * STEP_S)
    scatter = np.sqrt(((single - slope[:, None]) ** 2).mean(axis=1))
    trust = 1 / (1 + (scatter / human.half_trust_mps2) ** 2)
    change = trust * recent + (1 - trust) * slope
    # A large one is sooner an error of noisy tracks, and ends sooner on clean ones.
    lasting = change / np.hypot(1.0, change * np.hypot(scatter, human.lasting_mps2) / human.large_mps2**2)
    # Second differences of white noise have six times its variance; those of smooth motion are small.
    noise2 = (np.diff(single, n=2, axis=1) ** 2).mean(axis=1) / 6
    sudden = (single[:, -1] - lasting) / (1 + noise2 / human.noisy_mps2**2)
    now = np.maximum(speed[:, -1], 0.0)
    sudden, line = np.where(now < human.standing_mps, 0.0, sudden), speed.mean(axis=1) + slope * time[-1]
    return LastSecond(now, slope, recent, lasting, sudden, scatter, line - now, trust, turn_rate)


def keep_features(
    speed: FloatArray, bends: FloatArray, room: FloatArray, human: HumanParameters
) -> FloatArray:
    """Return (n, 3): speed, the sharper of bends (n, 2), and spare room, each over its largest value.

    Spare room is what half the width of the wider lane exceeds the largest offset by; ``room``: (n, 2, 2),
    see `PathObservations`.
    """
    spare = np.clip(room.mean(axis=2).max(axis=1) - human.max_offset_m, 0.0, human.max_spare_m)
    bend = np.abs(bends).max(axis=1) / human.max_bend
    speed = np.minimum(speed, human.max_speed_mps) / human.max_speed_mps
    return np.column_stack([speed, bend, spare / human.max_spare_m])


def place_features(lateral: FloatArray, bends: FloatArray, room: FloatArray) -> FloatArray:
    """Return (n, 5) ``lateral`` (n, 3), ``bends`` (n, 2); the offset shrinks with a lane that narrows.

    ``room``: (n, 2, 2), see `PathObservations`.
    """
    here, ahead = room.mean(axis=2).T
    shrinks = np.where(ahead > 0, np.minimum(ahead / np.maximum(here, ahead + 1e-9), 1.0), 1.0)
    return np.column_stack([lateral[:, 0] * shrinks, lateral[:, 1:], bends])


def offset_limits(room: FloatArray, human: HumanParameters) -> FloatArray:
    """Return (n, 2) largest offsets to the left and right without a lane change, m, by room (n, 2), m."""
    return np.maximum(room - CLEAR_M, human.max_offset_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class PathObservations:
    """Observations along each path, (P,)."""

    leader: IntArray  # as in `Leaders`
    gap: FloatArray  # m; inf without a leader
    leader_speed: FloatArray  # m/s along the path
    limit: FloatArray  # speed limit, m/s
    curve: FloatArray  # speed that the curves ahead allow a moment later, m/s
    headway: FloatArray  # largest one that the driver keeps, s
    lateral: FloatArray  # (P, 3) motion of the rear axle across the path: m, left positive; m/s; m/s²
    bends: FloatArray  # (P, 2) curvatures here and 3 s ahead, left positive, 1/m
    room: FloatArray  # (P, 2, 2) to the left and right bound of the lane here and 3 s ahead, m
    # (P, 8) 1, shown acceleration, that of the model, speed difference to the leader, line error, limit minus
    # speed, braking that curves need, comfortable speed in the curve ahead minus speed
    mean_features: FloatArray
    spread_features: FloatArray  # (P, 3) scatter, size of the acceleration, leader near or not


@owner_cache
def observations_of(scene: SeedScene, paths: SeedPaths, human: HumanParameters) -> PathObservations:
    """Observe vehicles along each of their paths."""
    history, vehicle = SceneHistory.of_scene(scene), np.repeat(np.arange(scene.vehicles), paths.count)
    row, shown, idm = np.arange(len(vehicle)), last_second(scene, human), human.idm
    vehicles = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    now, speed = scene.now[vehicle], shown.speed[vehicle]
    s, _, _ = paths.foot_points(row, now.x, now.y, np.full(len(row), BEHIND_M))
    view = View(history, vehicles, paths, row, s, human)
    lateral = _lateral(view)
    leaders = leaders_of(view, lateral[:, 0])
    gap, near = leaders.gap, leaders.gap < human.far_leader_m
    size = np.minimum(np.abs(shown.acceleration[vehicle]), human.max_size_mps2)
    scatter = np.minimum(shown.scatter[vehicle], human.max_scatter_mps2)
    curves = curve_speeds(paths, idm.curve_acceleration, idm.curve_deceleration)
    places = s, s + human.lateral_s * speed
    bends = np.stack([paths.bend_at(row, place) for place in places], axis=1)
    nowhere = np.zeros((len(row), 2))
    room = [nowhere if scene.road is None else room_at(scene.road, paths, place) for place in places]
    return PathObservations(
        leader=leaders.index,
        gap=gap,
        leader_speed=leaders.speed,
        limit=desired_speeds(paths, idm.speed, idm.speed_factor)[paths.sample_at(row, s)],
        curve=curves[paths.sample_at(row, s + speed * CURVE_TIME_S)],
        headway=kept_headway(gap, speed, human),
        lateral=lateral,
        bends=np.clip(bends, -human.max_bend, human.max_bend),
        room=np.stack(room, axis=1),
        mean_features=_mean_features(view, leaders, gap, near),
        spread_features=np.column_stack([scatter, size, near.astype(np.float64)]),
    )


def _mean_features(view: View, leaders: Leaders, gap: FloatArray, near: BoolArray) -> FloatArray:
    """Return (P, 8); see `PathObservations`."""
    human, shown, vehicle = view.human, view.shown, view.vehicles.vehicle
    speed, ahead = shown.speed[vehicle], int((BEHIND_M + human.limit_ahead_m) / DS_M)
    sample = view.paths.sample_at(view.row, view.s + human.curve_ahead_s * speed)
    there = view.paths.curve_curvature.ravel()[sample]
    features = (
        shown.acceleration[vehicle],
        idm_acceleration(human.idm, speed, np.full_like(speed, np.inf), gap, leaders.speed),
        np.where(near, leaders.speed - speed, 0.0),
        shown.line_error[vehicle],
        view.paths.speed_limit[view.row, ahead] - speed,
        braking_for_turns(view.paths, view.s, speed, human.easy_mps2, human),
        np.sqrt(human.easy_mps2 / np.maximum(there, 1e-6)) - speed,
    )
    limited = (np.clip(v, *most) for v, most in zip(features, human.mean_ranges, strict=True))
    return np.column_stack([np.ones_like(speed), *limited])


def braking_for_turns(
    paths: SeedPaths, s: FloatArray, speed: FloatArray, lateral: float, human: HumanParameters
) -> FloatArray:
    """Return (P,) braking, m/s², that the curves ahead of each path need for a lateral acceleration, m/s²."""
    ahead = DS_M * np.arange(paths.samples) - s[:, None]
    excess = speed[:, None] ** 2 - lateral / np.maximum(paths.curve_curvature, 1e-6)
    near, far = human.turn_range_m
    counts = np.abs(ahead - far / 2) < far / 2
    needed = np.where(counts, excess, 0.0) / (2 * np.maximum(ahead, near))
    return np.asarray(np.maximum(needed.max(axis=1), 0.0))


def _lateral(view: View) -> FloatArray:
    scene, vehicle, paths, human = view.scene, view.vehicles.vehicle, view.paths, view.human
    now, speed = scene.now[vehicle], view.shown.speed[vehicle]
    x, y = rear_axle(now, scene.length[vehicle])
    s, offset, along = paths.foot_points(view.row, x, y, np.full(len(vehicle), BEHIND_M))
    swerve = speed * np.sin(now.heading - along)
    turning = speed * (view.shown.turn_rate[vehicle] - speed * paths.bend_at(view.row, s))
    limit = np.array([human.max_offset_m, human.max_lateral, human.max_lateral])
    return np.asarray(np.clip(np.column_stack([offset, swerve, turning]), -limit, limit))


def path_features(scene: SeedScene, paths: SeedPaths, human: HumanParameters) -> FloatArray:
    """Return (P, 5) features of each path.

    Missing braking, m/s²: what the curves ahead need more than it shows; excessive speed, m/s: what even hard
    braking and sharp curves do not bring down; heading error, rad; offset, m, and heading error, rad, after
    the shown turn has gone on for a moment.
    """
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    row, shown = np.arange(len(vehicle)), last_second(scene, human)
    now, speed = scene.now[vehicle], shown.speed[vehicle]
    s, _, heading = paths.foot_points(row, now.x, now.y, np.full(len(row), BEHIND_M))
    needed = braking_for_turns(paths, s, speed, human.turn_mps2, human)
    shown_braking = np.clip(shown.acceleration[vehicle], *human.missing_range_mps2)
    missing = np.where(needed > 0, needed + shown_braking, 0.0)
    allowed = curve_speeds(paths, human.idm.curve_acceleration, human.idm.curve_deceleration)
    missing = np.clip(missing, 0.0, human.max_missing_mps2)
    excessive = np.maximum(now.speed - allowed[paths.sample_at(row, s)], 0.0)
    errors = np.abs(wrap(now.heading - heading)), *_after_turn(scene, paths, human)
    return np.column_stack([missing, excessive, *errors])


def _after_turn(scene: SeedScene, paths: SeedPaths, human: HumanParameters) -> tuple[FloatArray, FloatArray]:
    """Return (P,) offsets, m, and heading errors, rad, after the turn of the last steps has gone on."""
    vehicle, now, time_s = np.repeat(np.arange(scene.vehicles), paths.count), scene.now, human.turn_goes_on_s
    shown = last_second(scene, human)
    turn = np.clip(shown.turn_rate, -human.max_turn_rad_s, human.max_turn_rad_s) * time_s
    x, y = rear_axle(now, scene.length)
    distance_m = shown.speed * time_s
    chord, course = distance_m * np.sinc(turn / (2 * np.pi)), now.heading + turn / 2
    x, y = x + chord * np.cos(course), y + chord * np.sin(course)
    row = np.arange(len(vehicle))
    _, offset, heading = paths.foot_points(row, x[vehicle], y[vehicle], BEHIND_M + distance_m[vehicle])
    return np.abs(offset), np.abs(wrap((now.heading + turn)[vehicle] - heading))


@owner_cache
def path_weights(scene: SeedScene, paths: SeedPaths, human: HumanParameters) -> FloatArray:
    """Return (P,) relative probabilities, above 0, of each vehicle's paths."""
    share = np.diff(paths.draw_edges, prepend=0.0)
    share[paths.first] = paths.draw_edges[paths.first]
    cost = path_features(scene, paths, human) @ human.path_costs
    return np.asarray(np.maximum(share, 1e-9) * np.exp(-cost) + 1e-12)


def path_edges(scene: SeedScene, paths: SeedPaths, human: HumanParameters) -> FloatArray:
    """Return (P,) upper edges in [0, 1] of paths' shares of a draw."""
    return upper_edges(path_weights(scene, paths, human), paths.first, paths.count)


@owner_cache
def lane_bounds(road: Road) -> dict[int, tuple[shapely.LineString, shapely.LineString]]:
    """Return the left and right bound of each lane."""
    return {
        number: (shapely.LineString(lane.left_bound), shapely.LineString(lane.right_bound))
        for number, lane in road.vehicle_lanes.items()
    }


@owner_cache
def lane_areas(road: Road) -> dict[int, shapely.Polygon]:
    """Return the area of each lane."""
    return {number: shapely.Polygon(lane.outline) for number, lane in road.vehicle_lanes.items()}


def room_at(road: Road, paths: SeedPaths, s: FloatArray) -> FloatArray:
    """Return (P, 2) distances from places (P,) on paths to the left and right bound of their lane, m.

    Of the lanes of a path that contain the place the narrowest counts; off the lanes the room is 0.
    """
    x, y = paths.at(np.arange(len(s)), s)[:2]
    row = np.repeat(np.arange(len(s)), [len(lanes) for lanes in paths.lanes])
    lanes = [lane for lanes_of_path in paths.lanes for lane in lanes_of_path]
    bounds, areas = lane_bounds(road), lane_areas(road)
    inside = shapely.contains_xy(np.array([areas[lane] for lane in lanes], dtype=object), x[row], y[row])
    row, sides = row[inside], [bounds[lane] for lane, there in zip(lanes, inside, strict=True) if there]
    far = shapely.distance(shapely.points(x, y)[row, None], np.array(sides, dtype=object).reshape(-1, 2))
    order = np.lexsort((far.sum(axis=1), row))
    path, narrowest = np.unique(row[order], return_index=True)
    room = np.zeros((len(s), 2))
    room[path] = far[order[narrowest]]
    return room
