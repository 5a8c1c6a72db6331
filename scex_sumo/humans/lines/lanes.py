"""Lane changes of `LikelyDriver`: the lanes beside a path, and the probability of a change."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths
from scex_sumo.geometry.polylines import samples
from scex_sumo.humans.observed.observations import last_second, observations_of
from scex_sumo.humans.parameters import HumanParameters
from scex_sumo.road import Lane, Road
from scex_sumo.scene import SeedScene

_POINT_M = 4.0


@owner_cache
def _centrelines_beside(road: Road) -> dict[int, tuple[FloatArray | None, ...]]:

    def line(lane: Lane, sides: tuple[int | None, ...]) -> FloatArray | None:
        beside = next((side for side in sides if side in road.lanes), None)
        return None if beside is None else samples(road.lanes[beside].centreline, _POINT_M)[1]

    return {
        number: (line(lane, (lane.adjacent_left, lane.left)), line(lane, (lane.adjacent_right, lane.right)))
        for number, lane in road.lanes.items()
    }


@owner_cache
def lanes_beside(scene: SeedScene, road: Road, paths: SeedPaths, human: HumanParameters) -> FloatArray:
    """Return (P, 2) distances from paths to the middle of the lane on the left and right, m, or inf."""
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    reach = np.maximum(scene.now.speed, human.change_speed_mps)[vehicle, None] * np.array(human.lane_ahead_s)
    lines, (nearest, farthest) = _centrelines_beside(road), human.lane_beside_m
    beside = np.full((len(vehicle), 2), np.inf)
    for side, sign in ((0, 1.0), (1, -1.0)):
        pairs = [
            (row, line)
            for row, lanes in enumerate(paths.lanes)
            for line in (lines[lane][side] for lane in lanes if lane in lines)
            if line is not None
        ]
        if not pairs:
            continue
        row = np.repeat([r for r, _ in pairs], [len(line) for _, line in pairs])
        x, y = np.concatenate([line for _, line in pairs]).T
        now = scene.now[vehicle[row]]
        ahead, _ = now.ahead_and_left(x, y)
        near = (ahead > 0) & (np.hypot(x - now.x, y - now.y) < reach[row, 1] + 2 * farthest)
        row, x, y, ahead = row[near], x[near], y[near], ahead[near]
        s, offset, _ = paths.foot_points(row, x, y, BEHIND_M + ahead)
        distance_m, off = s - BEHIND_M, sign * offset
        good = (
            (distance_m > reach[row, 0]) & (distance_m < reach[row, 1]) & (off > nearest) & (off < farthest)
        )
        count = np.bincount(row[good], minlength=len(vehicle))
        total = np.bincount(row[good], weights=off[good], minlength=len(vehicle))
        beside[count > 0, side] = total[count > 0] / count[count > 0]
    return beside


@owner_cache
def lanes_occupied(scene: SeedScene, human: HumanParameters, headway_s: float = 0.0) -> BoolArray:
    """Return (V, 2) whether a vehicle is, or soon will be, on the left and right, or a headway behind."""
    others = scene.now
    now, length, width = others[:, None], scene.length[:, None], scene.width[:, None]
    ahead, left = now.ahead_and_left(others.x, others.y)
    opening = others.speed * np.cos(others.heading - now.heading) - now.speed
    # when they are nearest
    soon = np.clip(-ahead / np.where(opening == 0, 1.0, opening), 0.0, human.occupied_s)
    apart = np.abs(ahead + soon * opening) - (length + scene.length) / 2
    room = np.abs(left) - (width + scene.width) / 2
    behind = np.where(ahead + soon * opening < 0, others.speed, now.speed)
    near = apart < human.occupied_along_m + headway_s * behind
    near &= (room > -human.occupied_along_m) & (room < human.occupied_across_m)
    np.fill_diagonal(near, False)
    return np.stack([(near & side).any(axis=1) for side in (left > 0, left < 0)], axis=1)


def change_features(
    lateral: FloatArray, beside: FloatArray, occupied: BoolArray, scatter: FloatArray, human: HumanParameters
) -> FloatArray:
    """Return (n, 2, 7) features of a change to the left, and to the right, by scatter (n,) of accelerations.

    1; trust in lateral motion; no lane mapped; lane occupied; offset, m, speed, m/s, and acceleration, m/s²,
    towards that side, times the trust.
    """
    trust = 1 / np.hypot(1.0, scatter * human.lateral_doubt)
    towards = trust[:, None, None] * lateral[:, None] * np.array([1.0, -1.0])[:, None]
    rest = np.stack([np.ones_like(beside), np.tile(trust[:, None], 2), np.isinf(beside), occupied], axis=2)
    return np.concatenate([rest, towards], axis=2)


@owner_cache
def change_shares(scene: SeedScene, road: Road, paths: SeedPaths, human: HumanParameters) -> FloatArray:
    """Return (P, 2) probabilities of a change to the lane on the left, and on the right."""
    observed = observations_of(scene, paths, human)
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    beside, occupied = lanes_beside(scene, road, paths, human), lanes_occupied(scene, human)[vehicle]
    scatter = observed.spread_features[:, 0]
    features = change_features(observed.lateral, beside, occupied, scatter, human)
    odds = np.exp(np.minimum(features @ human.change_weights, 30.0))
    shares: FloatArray = odds / (1 + odds.sum(axis=1, keepdims=True))
    slow = last_second(scene, human).speed[vehicle, None] < human.change_speed_mps
    occupied |= lanes_occupied(scene, human, human.occupied_headway_s)[vehicle]
    return np.where(slow | occupied & (shares < human.occupied_min_share), 0.0, shares)


def change_offsets(lateral: FloatArray, beside: FloatArray, human: HumanParameters) -> FloatArray:
    """Return (n, 2) offsets from the path 3 s after a change to the left, and to the right, m."""
    sign = np.array([1.0, -1.0])
    lane = np.where(np.isinf(beside), human.lane_width_m, beside)
    far, offset, speed = human.change_target
    return np.asarray(sign * far * lane + offset * lateral[:, :1] + speed * lateral[:, 1:2])
