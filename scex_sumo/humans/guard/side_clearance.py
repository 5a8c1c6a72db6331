"""Room beside vehicles: offsets from a path that keep boxes apart."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.leaders import BoxesOnPaths, everyone
from scex_sumo.behaviors.driving.paths import OnPath
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.scene import STEP_S, SeedScene

NEAR_M = 25.0  # between centres of vehicles that can get beside each other within a plan
MARGIN_M = 0.4  # between two boxes
AHEAD_M = 1.0  # boxes this far ahead or behind count as beside
ALONG = 0.5  # sine of the angle to the path; at larger angles a vehicle crosses it
STRAIGHTENS_S, STRAIGHTENS_M = 1.0, 6.0  # after this time, at least this way, a third of an angle is left
OWN_DRIFT_S = 0.3  # the vehicle stops its own drift sooner
ASIDE_SPEED = 0.8  # m/s, lateral, towards a narrower place ahead
ASIDE_M, ASIDE_S = 0.5, 1.0  # largest shift, and its time constant, away from a box that is too near


def offsets_beside(
    on: OnPath,
    s: FloatArray,
    travelled_m: FloatArray,
    *,
    margin: float = MARGIN_M,
    passing: float | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return (n, H + 1) smallest and largest offset from the path, m; infinite without vehicles beside.

    Two boxes share the space between them; others keep their speed and straighten up.

    Args:
        s: (n,) arc length of the centre now on the paths, m; ``travelled_m``: (n, H + 1) further way.
        margin: between two boxes, m; ``passing``: to people, who share nothing; None: as to vehicles.
    """
    history, vehicles, paths, path = on
    everybody, now = everyone(history), on.now
    others = everybody.states[vehicles.future]
    near = np.hypot(others.x - now.x[:, None], others.y - now.y[:, None]) < NEAR_M
    near &= everybody.present[vehicles.future]
    near[np.arange(len(vehicles)), vehicles.vehicle] = False
    i, j = np.nonzero(near)
    mine, theirs = ((everybody.length[k], everybody.width[k]) for k in (vehicles.vehicle, j))
    own = BoxesOnPaths.of(paths.foot_points(path, now.x, now.y, s), now.heading, *mine).take(i)
    states = everybody.states[vehicles.future[i], j]
    other = BoxesOnPaths.of(paths.foot_points(path[i], states.x, states.y, s[i]), states.heading, *theirs)
    own_speed, speed = np.maximum(now.speed[i], 0.0) * own.cos, np.maximum(states.speed, 0.0) * other.cos
    t: FloatArray = STEP_S * np.arange(travelled_m.shape[1], dtype=np.float64)
    ahead = (other.s - own.s)[:, None] + speed[:, None] * t - travelled_m[i]
    along, apart = own.along + other.along, np.abs(other.offset - own.offset)
    beside = (np.abs(ahead[:, 0]) < along) | (apart > own.across + other.across)
    beside &= (np.abs(other.sin) < ALONG) & (np.abs(ahead) < along[:, None] + AHEAD_M).any(axis=1)
    k = np.flatnonzero(beside)
    i, j, own, other, ahead, apart = i[k], j[k], own.take(k), other.take(k), ahead[k], apart[k]
    side = np.where(other.offset > own.offset, 1.0, -1.0)
    alone = everybody.obstacle[j] & (passing is not None)
    kept = np.where(alone, passing or 0.0, margin)[:, None]
    free = apart[:, None] - _taken(own, other, own_speed[k], speed[k], side, theirs[1][k], t) - kept
    counts = np.abs(ahead) < (own.along + other.along)[:, None] + AHEAD_M
    own_share = np.where(alone, 1.0, 0.5)[:, None]
    room = reached(np.where(counts, np.maximum(own_share * free, -ASIDE_M), np.inf))
    room *= np.where(room < 0, 1 - np.exp(-t / ASIDE_S), 1.0)
    least, most = np.full(travelled_m.shape, -np.inf), np.full(travelled_m.shape, np.inf)
    left, right = side > 0, side < 0
    np.minimum.at(most, i[left], own.offset[left, None] + room[left])
    np.maximum.at(least, i[right], own.offset[right, None] - room[right])
    return least, most


def _taken(
    own: BoxesOnPaths,
    other: BoxesOnPaths,
    own_speed: FloatArray,
    speed: FloatArray,
    side: FloatArray,
    width: FloatArray,
    t: FloatArray,
) -> FloatArray:
    """Return (p, H + 1) distances across the path that the boxes occupy between their centres, m."""
    straightens = np.maximum(STRAIGHTENS_S * np.abs(speed), STRAIGHTENS_M)
    left = np.exp(-np.abs(speed)[:, None] * t / straightens[:, None])
    drift = np.maximum(-side * other.sin, 0.0) * straightens
    own_drift = np.maximum(side * own_speed * own.sin, 0.0) * OWN_DRIFT_S
    turned, straight = other.across[:, None], (width / 2 + drift)[:, None]
    return np.asarray((own.across + own_drift)[:, None] + straight + (turned - straight) * left)


def reached(room: FloatArray) -> FloatArray:
    """Return (n, H + 1) room from which the later room can be reached at `ASIDE_SPEED`."""
    reach = ASIDE_SPEED * STEP_S * np.arange(room.shape[1])
    return np.asarray(np.minimum.accumulate((room + reach)[:, ::-1], axis=1)[:, ::-1] - reach)


@owner_cache
def box_distances(scene: SeedScene) -> FloatArray:
    """(V, V) distance of the vehicles' boxes in a seed scene, m."""
    now, length, width = scene.now[:, None], scene.length[:, None], scene.width[:, None]
    return rectangle_distance(Rectangles.of(now, length, width), Rectangles.of(scene.now, length.T, width.T))
