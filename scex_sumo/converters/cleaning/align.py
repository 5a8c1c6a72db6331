"""Alignment of tracks to their map: a residual offset, estimated from where vehicles drive, and undone.

Trackers and maps are surveyed apart, and often disagree by most of a metre and a degree: vehicles then drive
beside their lanes. Over a whole recording the disagreement shows, for drivers keep near the middle of lanes
that run in several directions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

MOVING_MPS = 2.0  # slower samples tell nothing about lanes
EVERY_M = 1.0  # one sample for so much driven path
MOST_SAMPLES = 2000  # more are thinned out evenly
OWN_TRACKS, ENOUGH_TRACKS = 100, 200  # with fewer, other recordings of the site are asked, until so many
MIN_SAMPLES, MIN_TRACKS = 500, 20  # with fewer nothing is done
# So much of the evidence must drive more than 45° off the main direction: on a road of one direction an
# offset cannot be told from a habit of driving beside the middle.
DIRECTION_SHARE = 0.1
LANE_SIGMA_M = 0.5  # how far from the middle drivers keep; samples farther off count ever less
SHIFT_SIGMA_M = 1.0  # usual offsets; they decide where the lanes say nothing (along a straight road) ...
TURN_SIGMA_RAD = math.radians(1.5)  # ... as this does for rotations
# The evidence counts as at most so many independent observations: samples of one track are off alike, and
# tracks of one lane share the map's own error there.
INDEPENDENT = 30
LEAST_M = 0.3  # offsets that move the samples by less, across their lanes, are left
# Share by which the median deviation from how vehicles usually keep in their lanes must shrink, for tracks
# that the offset was not estimated from.
LEAST_GAIN = 0.2
MOST_M = 3.0  # a larger offset is no residual one: the map's origin is wrong
_ROUNDS, _STILL_M, _STILL_RAD = 6, 0.005, 1e-4


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Poses of moving vehicles, one for every metre driven.

    Attributes:
        x: (n,) m.
        y: (n,) m.
        heading: (n,) rad.
        track: (n,) numbers from 0 on.
    """

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    track: IntArray

    @property
    def tracks(self) -> int:
        """Number of tracks."""
        return int(self.track.max()) + 1 if len(self.track) else 0

    def take(self, keep: BoolArray) -> Evidence:
        """The samples where ``keep`` (n,) is True."""
        number = np.unique(self.track[keep], return_inverse=True)[1].astype(np.int64)
        return Evidence(x=self.x[keep], y=self.y[keep], heading=self.heading[keep], track=number)


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """A rotation about a point, then a shift, that moves tracks onto their lanes.

    Attributes:
        dx: m.
        dy: m.
        turn: rad, counter-clockwise.
        centre: point of rotation, m.
    """

    dx: float
    dy: float
    turn: float
    centre: tuple[float, float]

    def points(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where points are moved to."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        rx, ry = x - self.centre[0], y - self.centre[1]
        return self.centre[0] + c * rx - s * ry + self.dx, self.centre[1] + s * rx + c * ry + self.dy


def align_tracks(
    table: TrackTable, road: Road, *, siblings: Iterable[tuple[str, Evidence]] = ()
) -> tuple[TrackTable, str | None]:
    """Move a recording onto the lanes of its map, where its vehicles say that it is off.

    Shift and rotation are the least-squares fit of moving vehicles' centres to the centrelines of the lanes
    they match, every track counting by the root of its samples and samples far off (lane changes, parking)
    ever less; a common habit of driving left or right of the middle is estimated with them and left alone.

    Args:
        table: the recording, repaired.
        road: its map.
        siblings: name and evidence of other recordings of the same site by the same tracker, read only where
            the recording's own evidence is thin.

    Returns:
        The table, and a phrase with the shift and what it brought; the table itself and None where the
        evidence is too little, or the tracks lie right.
    """
    own = evidence(table.vehicles)
    parts = [(table.path.name, own)]
    if own.tracks < OWN_TRACKS:
        for sibling in siblings:
            if sum(part.tracks for _, part in parts) >= ENOUGH_TRACKS:
                break
            parts.append(sibling)
    # By name: the same recordings in any order give the same bits.
    pooled = _thinned(_pooled([part for _, part in sorted(parts, key=lambda named: named[0])]))
    found = find_alignment(pooled, road)
    if found is None:
        return table, None
    alignment, before, after = found
    others = f", estimated from {len(parts)} recordings of the site" if len(parts) > 1 else ""
    finding = (
        f"tracks aligned to the map: dx {alignment.dx:+.2f} m, dy {alignment.dy:+.2f} m, rotation "
        f"{math.degrees(alignment.turn):+.2f} degrees (median distance to lane centre {before:.2f} -> "
        f"{after:.2f} m{others})"
    )
    vehicles, rest = _moved(table.vehicles, alignment), _moved(table.others, alignment)
    return replace(table, vehicles=vehicles, others=rest), finding


def evidence(rows: TrackRows) -> Evidence:
    """One pose for every metre that vehicles drive."""
    joined = np.diff(rows.segment) == 0
    step = np.where(joined, np.hypot(np.diff(rows.x), np.diff(rows.y)), 0.0)
    mark = np.floor(np.append(0.0, np.cumsum(step)) / EVERY_M)
    keep = np.append(True, ~joined | (np.diff(mark) > 0.0))[: len(rows)] & (rows.speed > MOVING_MPS)
    track = np.unique(rows.track[keep], return_inverse=True)[1].astype(np.int64)
    return Evidence(x=rows.x[keep], y=rows.y[keep], heading=rows.psi_rad[keep], track=track)


def find_alignment(samples: Evidence, road: Road) -> tuple[Alignment, float, float] | None:
    """The offset of samples to their lanes, with the median distance to the lane's middle before and after.

    Returns:
        None where there are too few samples or directions, or the offset is too small or explains too little.
    """
    if len(samples.x) < MIN_SAMPLES or samples.tracks < MIN_TRACKS or _one_way(samples.heading):
        return None
    fit = _fit(samples, road)
    stay = replace(fit, dx=0.0, dy=0.0, turn=0.0)
    before, after = _offsets(samples, road, stay), _offsets(samples, road, fit)
    moved_m = float(np.median(np.abs(_across(samples, fit))))
    if moved_m < LEAST_M or math.hypot(fit.dx, fit.dy) > MOST_M:
        return None
    # The gain must show on tracks that the estimate has not seen.
    even: BoolArray = samples.track % 2 == 0
    unseen = [_offsets(samples.take(~half), road, _fit(samples.take(half), road)) for half in (even, ~even)]
    if _spread(np.concatenate(unseen)) > (1.0 - LEAST_GAIN) * _spread(before):
        return None
    return fit, float(np.median(np.abs(before))), float(np.median(np.abs(after)))


def on_lanes(samples: Evidence, road: Road) -> float:
    """Share of samples that match a lane; 1 where there are none to judge by."""
    few = _thinned(samples, most=400)
    if not len(few.x):
        return 1.0
    return len(np.unique(match(road, few.x, few.y, few.heading).vehicle)) / len(few.x)


def lane_distance(samples: Evidence, road: Road) -> float:
    """Median distance of samples to the middle of the lane they match, m; nan without any."""
    few = _thinned(samples)
    stay = Alignment(dx=0.0, dy=0.0, turn=0.0, centre=(0.0, 0.0))
    offsets = _offsets(few, road, stay) if len(few.x) else np.zeros(0)
    return float(np.median(np.abs(offsets))) if len(offsets) else math.nan


def _fit(samples: Evidence, road: Road) -> Alignment:
    """Gauss-Newton on weighted offsets, matching anew in every round."""
    centre = float(samples.x.mean()), float(samples.y.mean())
    found = Alignment(dx=0.0, dy=0.0, turn=0.0, centre=centre)
    habit = 0.0
    shift, turn = SHIFT_SIGMA_M**-2.0, TURN_SIGMA_RAD**-2.0
    prior = np.diag([shift, shift, turn, LANE_SIGMA_M**-2.0])
    independent = min(samples.tracks, INDEPENDENT)
    for _ in range(_ROUNDS):
        x, y, u, who, offset = _matched(samples, road, found)
        if not len(who):
            return found
        nx, ny = -np.sin(u), np.cos(u)
        arm = -nx * (y[who] - centre[1] - found.dy) + ny * (x[who] - centre[0] - found.dx)
        slopes = np.stack((nx, ny, arm, np.ones(len(who))), axis=1)
        now = np.array((found.dx, found.dy, found.turn, habit))
        step = np.zeros(4)
        for _ in range(3):
            rest = offset + habit + slopes @ step
            weight = 1.0 / (1.0 + (rest / LANE_SIGMA_M) ** 2)
            of_track = np.bincount(samples.track[who], weight, samples.tracks)
            weight = weight / np.sqrt(np.maximum(of_track, 1e-9))[samples.track[who]]
            weight *= independent / (weight.sum() * LANE_SIGMA_M**2)
            left = (slopes * weight[:, None]).T
            step = np.linalg.solve(left @ slopes + prior, -left @ (offset + habit) - prior @ now)
        dx, dy, turn, habit = (float(value) for value in now + step)
        found = replace(found, dx=dx, dy=dy, turn=turn)
        if np.abs(step[:2]).max() < _STILL_M and abs(step[2]) < _STILL_RAD:
            break
    return found


def _matched(
    samples: Evidence, road: Road, alignment: Alignment
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, FloatArray]:
    """Moved x, y (n,); and of those that match a lane (m,) its direction, the sample, the offset."""
    x, y = alignment.points(samples.x, samples.y)
    heading = wrap(samples.heading + alignment.turn)
    matches = match(road, x, y, heading)
    best = np.append(True, np.diff(matches.vehicle) != 0)[: len(matches.vehicle)]
    who = matches.vehicle[best]
    return x, y, heading[who] - matches.heading_error[best], who, matches.offset[best]


def _offsets(samples: Evidence, road: Road, alignment: Alignment) -> FloatArray:
    """(m,) of the samples that are on lanes, how far left of the lane's middle they are, m."""
    return _matched(samples, road, alignment)[4]


def _spread(offsets: FloatArray) -> float:
    """Median deviation from the usual offset, m; inf without any."""
    return float(np.median(np.abs(offsets - np.median(offsets)))) if len(offsets) else math.inf


def _across(samples: Evidence, alignment: Alignment) -> FloatArray:
    """(n,) by how much samples are moved across their heading, m."""
    x, y = alignment.points(samples.x, samples.y)
    return (y - samples.y) * np.cos(samples.heading) - (x - samples.x) * np.sin(samples.heading)


def _one_way(heading: FloatArray) -> bool:
    """Whether almost all drive in one direction."""
    bins = np.bincount((np.floor(heading / (np.pi / 8.0)).astype(np.int64)) % 16, minlength=16)
    main = (np.argmax(bins) + 0.5) * np.pi / 8.0
    elsewhere = np.abs(wrap(heading - main)) > np.pi / 4.0
    return bool(elsewhere.mean() < DIRECTION_SHARE)


def _pooled(parts: Sequence[Evidence]) -> Evidence:
    begins = np.cumsum([0, *(part.tracks for part in parts)])
    return Evidence(
        x=np.concatenate([part.x for part in parts]),
        y=np.concatenate([part.y for part in parts]),
        heading=np.concatenate([part.heading for part in parts]),
        track=np.concatenate([part.track + n for part, n in zip(parts, begins[:-1], strict=True)]),
    )


def _thinned(samples: Evidence, most: int = MOST_SAMPLES) -> Evidence:
    if len(samples.x) <= most:
        return samples
    chosen = np.zeros(len(samples.x), bool)
    chosen[np.linspace(0, len(samples.x) - 1, most).astype(np.int64)] = True
    return samples.take(chosen)


def _moved(rows: TrackRows, alignment: Alignment) -> TrackRows:
    x, y = alignment.points(rows.x, rows.y)
    return rows.turned(alignment.turn).with_columns(x=x, y=y)
