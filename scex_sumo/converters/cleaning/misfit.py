"""Misfit of tracks and map: whether the origin is wrong, or the map another place's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.cleaning.align import Evidence, on_lanes
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road

LEAST_ON_LANES = 0.1
"""A recording with a smaller share of its driving on lanes does not belong to its map."""
FITS = 0.8
"""With so much of the driving on lanes after a shift, the map is the right one."""
LEAST_TRACKS, LEAST_COURSES = 3, 3
CELL_M, COURSES, MOST_CELLS = 4.0, 8, 1500


def why_beside(samples: Evidence, road: Road) -> str:
    """Why tracks do not lie on a map's lanes: a phrase with the remedy.

    A wrong origin moves all tracks alike: where some shift puts them onto lanes, it is that; where none does,
    they belong to another map. Few tracks, or of few directions, fit any map somewhere and tell nothing.

    Args:
        samples: poses of moving vehicles.
        road: the map.
    """
    used = f"(used: {road.origin[0]:g},{road.origin[1]:g})"
    wrong = f"the map's origin is not the recording's {used}"
    both = f"{wrong}, or the map is another site's; give --origin LAT,LON"
    if samples.tracks < LEAST_TRACKS or len(np.unique(_course(samples.heading))) < LEAST_COURSES:
        return both
    shift = _best_shift(samples, road)
    if shift is None:
        return both
    dx, dy = shift
    share = on_lanes(replace(samples, x=samples.x + dx, y=samples.y + dy), road)
    if share >= FITS:
        return (
            f"{wrong}: moved by {dx:+.0f} m, {dy:+.0f} m, {share:.0%} of its driving is on lanes; give "
            "--origin LAT,LON"
        )
    return "and no other origin would put them there: the tracks are of another map; give theirs"


def _course(heading: FloatArray) -> FloatArray:
    """Direction in eighths of a turn, 0 to 7."""
    return np.asarray(np.rint(wrap(heading) / (2.0 * np.pi / COURSES)) % COURSES)


def _best_shift(samples: Evidence, road: Road) -> tuple[float, float] | None:
    """The shift in m that brings most poses onto lanes of their direction; None where all is too large."""
    from scipy.signal import fftconvolve  # as slow to import as all the rest, and hardly ever needed

    lines = [lane.centreline for lane in road.lanes.values() if lane.kind == "vehicle"]
    lanes = [_dense(line) for line in lines if len(line) > 1]
    if not lanes:
        return None
    lane_points = np.concatenate(lanes)
    poses = np.stack((samples.x, samples.y, samples.heading), axis=1)
    low = [points[:, :2].min(axis=0) for points in (lane_points, poses)]
    size = [np.ptp(points[:, :2], axis=0) // CELL_M + 1 for points in (lane_points, poses)]
    if max(float(s.max()) for s in size) > MOST_CELLS:
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
    """How many points lie in each cell."""
    counts = np.zeros(shape)
    np.add.at(counts, tuple(((points[:, :2] - begin) // CELL_M).astype(np.int64).T), 1.0)
    return counts


def _dense(line: FloatArray) -> FloatArray:
    """(n, 3) points of a line, one for each half cell, with its direction there."""
    step = np.diff(line, axis=0)
    length = np.hypot(*step.T)
    at = np.arange(0.0, length.sum(), CELL_M / 2.0)
    s = np.append(0.0, np.cumsum(length))
    segment = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(step) - 1)
    x, y = (np.interp(at, s, line[:, k]) for k in (0, 1))
    return np.stack((x, y, np.arctan2(step[segment, 1], step[segment, 0])), axis=1)
