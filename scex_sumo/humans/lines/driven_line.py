"""Driven line: the line along a route that people take within wide lanes, near the shortest one.

Lanelets of roundabouts and junctions are up to 14 m wide, and their centrelines are not what is driven. The
line is an elastic band in the room that the lanes leave: tension shortens it, stiffness rounds it, and a
spring draws it to the centreline.
"""

from __future__ import annotations

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray, IntArray, between
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths, gaussian
from scex_sumo.geometry.polylines import arc_lengths
from scex_sumo.humans.observed.observations import CLEAR_M, lane_bounds
from scex_sumo.road import Road

EVERY = 4  # samples of a path per knot of the band
STIFF_M = 6.0  # length over which the band rounds a kink
SPRING = 1.2  # with room, the band moves inwards by (this times half the width)² / radius
SWEEPS, STEP = 40, 2.0  # of the alternating direction method of multipliers, and its step
ROUND_M = 1.0  # of a Gaussian filter of the knots' shifts


def redrawn(road: Road, paths: SeedPaths) -> FloatArray:
    """Return the driven lines of the paths that lie on lanes, and the others as they are; see `Redraw`."""
    driven, s = paths.smooth.copy(), DS_M * np.arange(paths.samples, dtype=np.float64)
    room = {k: room_of(road, *line, s) for k, line in enumerate(paths.centrelines) if line is not None}
    if room:
        known = list(room)
        driven[known] = driven_lines(driven[known], paths.raw[known], np.stack([*room.values()]), DS_M)
    return driven


def room_of(road: Road, points: FloatArray, owner: IntArray, s: FloatArray) -> FloatArray:
    """Return (N, 2) distances to the left and right bound of the lanes along a centreline, m.

    ``points`` (M, 2), ``owner`` (M,) the lane under each, ``s`` (N,) arc lengths of the samples, m.
    """
    room = np.empty((len(points), 2))
    lanes = lane_bounds(road)
    for lane in np.unique(owner).tolist():
        mine = owner == lane
        where = shapely.points(points[mine])
        room[mine] = np.stack([shapely.distance(where, line) for line in lanes[lane]], axis=1)
    arc = arc_lengths(points)
    return np.stack([np.interp(s, arc, side) for side in room.T], axis=1)


def driven_lines(points: FloatArray, centre: FloatArray, room: FloatArray, ds: float) -> FloatArray:
    """Return (K, N, 2) lines within the room (K, N, 2) to the left and right of centrelines, m.

    ``points``: (K, N, 2) smoothed paths, on which the band begins.
    """
    step = np.gradient(points, axis=1)
    normal = np.stack([-step[..., 1], step[..., 0]], axis=2) / np.hypot(step[..., 0], step[..., 1])[..., None]
    moved = ((points - centre) * normal).sum(axis=2)
    most = np.maximum(room[..., 0] - CLEAR_M, 0.0) - moved
    least = -np.maximum(room[..., 1] - CLEAR_M, 0.0) - moved
    reach = SPRING * np.maximum(room.sum(axis=2) / 2, 1.0)
    knots = (values[:, ::EVERY] for values in (points, normal, least, most, moved, reach))
    shift = _band(EVERY * ds, *knots)
    fine = between(shift, np.arange(points.shape[1]) / EVERY)
    fine = gaussian(fine[..., None], ROUND_M / ds)
    return np.asarray(points + fine * normal)


def _band(
    h: float,
    points: FloatArray,
    normal: FloatArray,
    least: FloatArray,
    most: FloatArray,
    moved: FloatArray,
    reach: FloatArray,
) -> FloatArray:
    """Return (K, M) shifts of knots along their normals with the least energy, m."""
    count = points.shape[1]
    first, second = (np.diff(np.eye(count), n=n, axis=0) for n in (1, 2))
    stiff = first.T @ first / h + STIFF_M**2 * second.T @ second / h**3
    spring = h / reach**2
    hessian = stiff * (normal @ normal.swapaxes(1, 2)) + (spring + STEP)[..., None] * np.eye(count)
    force = ((stiff @ points) * normal).sum(axis=2) + spring * moved
    inverse = np.linalg.inv(hessian)
    held, push = np.clip(np.zeros_like(force), least, most), np.zeros_like(force)
    for _ in range(SWEEPS):
        free = (inverse @ (STEP * (held - push) - force)[..., None])[..., 0]
        held = np.clip(free + push, least, most)
        push += free - held
    return np.asarray(held)
