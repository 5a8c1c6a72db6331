"""Search for the shift of tracks that puts most of them onto the lanes of a map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import fftconvolve

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.cleaning.fit import fitted
from scex_sumo.converters.tracks.evidence import Evidence, on_lanes
from scex_sumo.geometry.polylines import along, arc_lengths, wrap
from scex_sumo.road import Road

MIN_TRACKS, MIN_COURSES = 3, 3
CELL_M, COURSES, MAX_CELLS = 4.0, 8, 1500


def find_shift(samples: Evidence, road: Road) -> tuple[float, float, float] | None:
    """Return the shift dx, dy, m, that puts most samples onto lanes, and their share on lanes then.

    None with too few tracks or directions, which fit any map.
    """
    if samples.tracks < MIN_TRACKS or len(np.unique(_course(samples.heading))) < MIN_COURSES:
        return None
    shift = _best_shift(samples, road)
    if shift is None:
        return None
    moved, dx, dy = fitted(replace(samples, x=samples.x + shift[0], y=samples.y + shift[1]), road)
    return shift[0] + dx, shift[1] + dy, on_lanes(moved, road)


def _course(heading: FloatArray) -> FloatArray:
    return np.asarray(np.rint(wrap(heading) / (2.0 * np.pi / COURSES)) % COURSES)


def _best_shift(samples: Evidence, road: Road) -> tuple[float, float] | None:
    lanes = [_dense(lane.centreline) for lane in road.vehicle_lanes.values() if len(lane.centreline) > 1]
    if not lanes:
        return None
    lane_points = np.concatenate(lanes)
    poses = np.stack((samples.x, samples.y, samples.heading), axis=1)
    low = [points[:, :2].min(axis=0) for points in (lane_points, poses)]
    size = [np.ptp(points[:, :2], axis=0) // CELL_M + 1 for points in (lane_points, poses)]
    if max(float(s.max()) for s in size) > MAX_CELLS:
        return None
    shape = [tuple(int(n) for n in s) for s in size]
    total = np.zeros([a + b - 1 for a, b in zip(*shape, strict=True)])
    for course in range(COURSES):
        there, here = (
            _cells(points[_course(points[:, 2]) == course], begin, cells)
            for points, begin, cells in zip((lane_points, poses), low, shape, strict=True)
        )
        if here.any():
            total += fftconvolve(np.minimum(there, 1.0), here[::-1, ::-1])
    at = np.array(np.unravel_index(int(np.argmax(total)), total.shape)) - (np.array(shape[1]) - 1)
    dx, dy = low[0] - low[1] + CELL_M * at
    return float(dx), float(dy)


def _cells(points: FloatArray, begin: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    counts = np.zeros(shape)
    np.add.at(counts, tuple(((points[:, :2] - begin) // CELL_M).astype(np.int64).T), 1.0)
    return counts


def _dense(line: FloatArray) -> FloatArray:
    arc = arc_lengths(line)
    s = np.arange(0.0, arc[-1], CELL_M / 2.0)
    segment = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(line) - 2)
    return np.column_stack((along(line, s), np.arctan2(*np.diff(line, axis=0)[segment].T[::-1])))
