"""Alignment of tracks to their map.

Tracks and map are surveyed independently and often differ by half a metre and a degree.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.evidence import Evidence, evidence, thinned
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

OWN_TRACKS, ENOUGH_TRACKS = 100, 200  # with fewer own tracks, other recordings of the site are read
MIN_SAMPLES, MIN_TRACKS = 500, 20  # with fewer nothing is done
MIN_OTHER_DIRECTIONS = 0.1
LANE_SIGMA_M = 0.5  # samples farther off the middle count less
SHIFT_SIGMA_M = 1.0  # usual offsets
TURN_SIGMA_RAD = math.radians(1.5)
# Number of independent observations at most: samples of one track share its error.
INDEPENDENT = 30
MIN_OFFSET_M = 0.3  # across the lanes; smaller offsets are left alone
MIN_GAIN = 0.3  # by which the spread within lanes must shrink, for tracks that the estimate has not seen
MAX_OFFSET_M = 3.0  # a larger offset means a wrong origin
_ROUNDS, _STILL_M, _STILL_RAD = 6, 0.005, 1e-4


def align_tracks(
    table: TrackTable, road: Road, *, siblings: Iterable[tuple[str, Evidence]] = ()
) -> tuple[TrackTable, tuple[str, ...]]:
    """Move a recording onto the lanes of its map if its vehicles drive beside them.

    Shift and rotation are the least-squares fit of moving vehicles' centres to the centrelines. A track
    counts by the root of its samples. A common habit of driving left or right of the middle is kept.

    ``siblings``, name and evidence of other recordings of the site, are read if the own evidence is thin.
    The phrase is about the shift; none if the evidence is too thin or the tracks are right.
    """
    parts = [(table.path.name, evidence(table.vehicles))]
    if parts[0][1].tracks < OWN_TRACKS:
        for sibling in siblings:
            if sum(part.tracks for _, part in parts) >= ENOUGH_TRACKS:
                break
            parts.append(sibling)
    pooled = thinned(_pooled([part for _, part in sorted(parts, key=lambda named: named[0])]))
    if len(pooled.x) < MIN_SAMPLES or pooled.tracks < MIN_TRACKS:
        return table, ()
    estimate = _find_alignment(pooled, road)
    if estimate is None:
        return table, ()
    alignment, before, after = estimate
    others = f", estimated from {len(parts)} recordings of the site" if len(parts) > 1 else ""
    finding = (
        f"tracks aligned to the map: dx {alignment.dx:+.2f} m, dy {alignment.dy:+.2f} m, rotation "
        f"{math.degrees(alignment.turn):+.2f} degrees (median distance to lane centre {before:.2f} -> "
        f"{after:.2f} m{others})"
    )
    vehicles, rest = alignment.moved(table.vehicles), alignment.moved(table.others)
    return replace(table, vehicles=vehicles, others=rest), (finding,)


def _pooled(parts: Sequence[Evidence]) -> Evidence:
    begins = np.cumsum([0, *(part.tracks for part in parts)])
    return Evidence(
        x=np.concatenate([part.x for part in parts]),
        y=np.concatenate([part.y for part in parts]),
        heading=np.concatenate([part.heading for part in parts]),
        track=np.concatenate([part.track + n for part, n in zip(parts, begins[:-1], strict=True)]),
    )


@dataclass(frozen=True, kw_only=True)
class _Alignment:
    """Shift in m, and turn about a centre in rad, that put tracks onto lanes."""

    dx: float
    dy: float
    turn: float
    centre: tuple[float, float]

    def points(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return moved points."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        rx, ry = x - self.centre[0], y - self.centre[1]
        return self.centre[0] + c * rx - s * ry + self.dx, self.centre[1] + s * rx + c * ry + self.dy

    def moved(self, rows: TrackRows) -> TrackRows:
        """Return moved tracks."""
        x, y = self.points(rows.x, rows.y)
        return rows.turned(self.turn).with_columns(x=x, y=y)


def _find_alignment(samples: Evidence, road: Road) -> tuple[_Alignment, float, float] | None:
    """Return the offset of samples to their lanes, and the median distance before and after, m; None
    if it is small or uncertain.
    """
    if _one_way(samples.heading):
        return None
    fit = _fit(samples, road)
    stay = replace(fit, dx=0.0, dy=0.0, turn=0.0)
    before, after = _offsets(samples, road, stay), _offsets(samples, road, fit)
    moved_m = float(np.median(np.abs(_across(samples, fit))))
    if moved_m < MIN_OFFSET_M or math.hypot(fit.dx, fit.dy) > MAX_OFFSET_M:
        return None
    even: BoolArray = samples.track % 2 == 0
    unseen = [_offsets(samples.take(~half), road, _fit(samples.take(half), road)) for half in (even, ~even)]
    if _spread(np.concatenate(unseen)) > (1.0 - MIN_GAIN) * _spread(before):
        return None
    return fit, float(np.median(np.abs(before))), float(np.median(np.abs(after)))


def fitted(samples: Evidence, road: Road) -> tuple[Evidence, float, float]:
    """Return samples moved onto the lanes near them, and the shift dx, dy, m."""
    few = thinned(samples)
    fit = _fit(few, road)
    x, y = fit.points(few.x, few.y)
    return replace(few, x=x, y=y, heading=few.heading + fit.turn), fit.dx, fit.dy


def nearest_lanes(
    road: Road, x: FloatArray, y: FloatArray, heading: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return indices, heading errors, rad, and offsets, m, of the poses that match a lane, the best one."""
    matches = match(road, x, y, heading)
    best = np.append(True, np.diff(matches.vehicle) != 0)[: len(matches.vehicle)]
    return matches.vehicle[best], matches.heading_error[best], matches.offset[best]


def _fit(samples: Evidence, road: Road) -> _Alignment:
    centre = float(samples.x.mean()), float(samples.y.mean())
    fit = _Alignment(dx=0.0, dy=0.0, turn=0.0, centre=centre)
    habit = 0.0
    shift, turn = SHIFT_SIGMA_M**-2.0, TURN_SIGMA_RAD**-2.0
    prior = np.diag([shift, shift, turn, LANE_SIGMA_M**-2.0])
    independent = min(samples.tracks, INDEPENDENT)
    for _ in range(_ROUNDS):
        x, y, u, sample, offset = _matched(samples, road, fit)
        if not len(sample):
            return fit
        nx, ny = -np.sin(u), np.cos(u)
        arm = -nx * (y[sample] - centre[1] - fit.dy) + ny * (x[sample] - centre[0] - fit.dx)
        slopes = np.stack((nx, ny, arm, np.ones(len(sample))), axis=1)
        now = np.array((fit.dx, fit.dy, fit.turn, habit))
        step = np.zeros(4)
        for _ in range(3):
            rest = offset + habit + slopes @ step
            weight = 1.0 / (1.0 + (rest / LANE_SIGMA_M) ** 2)
            of_track = np.bincount(samples.track[sample], weight, samples.tracks)
            weight = weight / np.sqrt(np.maximum(of_track, 1e-9))[samples.track[sample]]
            weight *= independent / (weight.sum() * LANE_SIGMA_M**2)
            left = (slopes * weight[:, None]).T
            step = np.linalg.solve(left @ slopes + prior, -left @ (offset + habit) - prior @ now)
        dx, dy, turn, habit = (float(value) for value in now + step)
        fit = replace(fit, dx=dx, dy=dy, turn=turn)
        if np.abs(step[:2]).max() < _STILL_M and abs(step[2]) < _STILL_RAD:
            break
    return fit


def _matched(
    samples: Evidence, road: Road, alignment: _Alignment
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, FloatArray]:
    x, y = alignment.points(samples.x, samples.y)
    heading = wrap(samples.heading + alignment.turn)
    sample, error, offset = nearest_lanes(road, x, y, heading)
    return x, y, heading[sample] - error, sample, offset


def _offsets(samples: Evidence, road: Road, alignment: _Alignment) -> FloatArray:
    return _matched(samples, road, alignment)[4]


def _spread(offsets: FloatArray) -> float:
    return float(np.median(np.abs(offsets - np.median(offsets)))) if len(offsets) else math.inf


def _across(samples: Evidence, alignment: _Alignment) -> FloatArray:
    x, y = alignment.points(samples.x, samples.y)
    return (y - samples.y) * np.cos(samples.heading) - (x - samples.x) * np.sin(samples.heading)


def _one_way(heading: FloatArray) -> bool:
    bins = np.bincount((np.floor(heading / (np.pi / 8.0)).astype(np.int64)) % 16, minlength=16)
    main = (np.argmax(bins) + 0.5) * np.pi / 8.0
    elsewhere = np.abs(wrap(heading - main)) > np.pi / 4.0
    return bool(elsewhere.mean() < MIN_OTHER_DIRECTIONS)
