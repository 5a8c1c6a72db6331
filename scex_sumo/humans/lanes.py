"""Lane changes of `LikelyDriver`: the lanes beside a path, and the probability of a change."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths
from scex_sumo.behaviors.driving.projection import foot_points
from scex_sumo.geometry.polylines import samples
from scex_sumo.humans.observations import last_second, observations_of
from scex_sumo.humans.population import Population
from scex_sumo.road import Lane, Road
from scex_sumo.scene import SeedScene

AHEAD_S = (0.5, 3.0)  # a lane counts if it is beside the vehicle's place in this time
MIN_SPEED_MPS = 3.0  # slower vehicles do not change
USUAL_M = 3.2  # lateral way of a change if no lane is mapped
BESIDE_M = (1.5, 5.0)  # distance of the next lane's centreline from the path
SOON_S = 2.0  # a vehicle that will be beside within this time occupies the lane
APART_M = 1.0  # between bodies, along the way
GAP_S = 0.3  # a smaller headway, ahead or behind, is no gap for a change
FREE_M = 2.5  # beside a vehicle; one further away is on a third lane
MIN_OCCUPIED = 0.2  # smallest probability of a change to an occupied lane
NOISE = 8.0  # 1/(m/s²): at a scatter of accelerations of 1 / NOISE, lateral motion counts by 0.7
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
def lanes_beside(scene: SeedScene, road: Road, paths: SeedPaths) -> FloatArray:
    """Return (P, 2) distances from paths to the middle of the lane on the left and right, m, or inf."""
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    reach = np.maximum(scene.now.speed, MIN_SPEED_MPS)[vehicle, None] * np.array(AHEAD_S)
    lines = _centrelines_beside(road)
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
        ahead, near = _ahead(scene, vehicle[row], x, y, reach[row])
        row, x, y, ahead = row[near], x[near], y[near], ahead[near]
        s, offset, _ = foot_points(paths, row, x, y, BEHIND_M + ahead)
        way, off = s - BEHIND_M, sign * offset
        good = (way > reach[row, 0]) & (way < reach[row, 1]) & (off > BESIDE_M[0]) & (off < BESIDE_M[1])
        count = np.bincount(row[good], minlength=len(vehicle))
        total = np.bincount(row[good], weights=off[good], minlength=len(vehicle))
        beside[count > 0, side] = total[count > 0] / count[count > 0]
    return beside


def _ahead(
    scene: SeedScene, vehicle: IntArray, x: FloatArray, y: FloatArray, reach: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """(n,) distance of points ahead of vehicles, m, and whether they may be within reach."""
    now = scene.now[vehicle]
    dx, dy = x - now.x, y - now.y
    ahead = np.cos(now.heading) * dx + np.sin(now.heading) * dy
    near: BoolArray = (ahead > 0) & (np.hypot(dx, dy) < reach[:, 1] + 2 * BESIDE_M[1])
    return ahead, near


@owner_cache
def lanes_taken(scene: SeedScene, headway_s: float = 0.0) -> BoolArray:
    """Return (V, 2) whether a vehicle is, or soon will be, on the left, and on the right.

    Args:
        headway_s: of a vehicle behind that counts, too.
    """
    now = scene.now
    cos, sin = np.cos(now.heading)[:, None], np.sin(now.heading)[:, None]
    dx, dy = now.x - now.x[:, None], now.y - now.y[:, None]
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    opening = now.speed * np.cos(now.heading - now.heading[:, None]) - now.speed[:, None]
    soon = np.clip(-ahead / np.where(opening == 0, 1.0, opening), 0.0, SOON_S)  # when they are nearest
    apart = np.abs(ahead + soon * opening) - (scene.length[:, None] + scene.length) / 2
    room = np.abs(left) - (scene.width[:, None] + scene.width) / 2
    behind = np.where(ahead + soon * opening < 0, now.speed, now.speed[:, None])
    near = (apart < APART_M + headway_s * behind) & (room > -APART_M) & (room < FREE_M)
    np.fill_diagonal(near, False)
    return np.stack([(near & side).any(axis=1) for side in (left > 0, left < 0)], axis=1)


def change_features(
    across: FloatArray, beside: FloatArray, taken: BoolArray, scatter: FloatArray
) -> FloatArray:
    """Return (n, 2, 7) features of a change to the left, and to the right.

    1; trust in lateral motion; no lane mapped; lane occupied; offset, m, speed, m/s, and acceleration, m/s²,
    towards that side, times the trust.

    Args:
        scatter: (n,) of accelerations, m/s².
    """
    trust = 1 / np.hypot(1.0, scatter * NOISE)
    towards = trust[:, None, None] * across[:, None] * np.array([1.0, -1.0])[:, None]
    rest = np.stack([np.ones_like(beside), np.tile(trust[:, None], 2), np.isinf(beside), taken], axis=2)
    return np.concatenate([rest, towards], axis=2)


@owner_cache
def change_shares(scene: SeedScene, road: Road, paths: SeedPaths, people: Population) -> FloatArray:
    """(P, 2) probability of a change to the lane on the left, and on the right."""
    observed = observations_of(scene, paths)
    vehicle = np.repeat(np.arange(scene.vehicles), paths.count)
    beside, taken = lanes_beside(scene, road, paths), lanes_taken(scene)[vehicle]
    features = change_features(observed.across, beside, taken, observed.unsure[:, 0])
    odds = np.exp(np.minimum(features @ people.change, 30.0))
    shares: FloatArray = odds / (1 + odds.sum(axis=1, keepdims=True))
    slow = last_second(scene).speed[vehicle, None] < MIN_SPEED_MPS
    taken |= lanes_taken(scene, GAP_S)[vehicle]
    return np.where(slow | taken & (shares < MIN_OCCUPIED), 0.0, shares)


def change_to(across: FloatArray, beside: FloatArray, people: Population) -> FloatArray:
    """(n, 2) offset from the path 3 s after a change to the left, and to the right, m, left positive."""
    sign = np.array([1.0, -1.0])
    lane = np.where(np.isinf(beside), USUAL_M, beside)
    far, offset, speed = people.change_to
    return np.asarray(sign * far * lane + offset * across[:, :1] + speed * across[:, 1:2])
