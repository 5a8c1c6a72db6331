"""Alignment of tracks to their map, by the poses of moving vehicles; why vehicles are off the lanes.

Tracks and map are surveyed independently and often differ by half a metre and a degree. Larger offsets are
a wrong origin, a map of another site, or lanes that are closed to cars.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError, listed
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable
from scex_sumo.geometry.polylines import along, arc_lengths, wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.scene import SeedScene

MIN_SHARE_ON_LANES = 0.1  # a recording with less of its driving on lanes does not belong to its map
FITTING_SHARE = 0.8  # with this much of the driving on lanes after a shift, the map is the right one
DOUBT_GAIN = 0.05  # of the driving that a shift must bring onto lanes before the origin is doubted
MIN_SHIFT_M = 2.0  # of an origin in doubt
EARTH_M = 111_320.0  # per degree of latitude
SHIFT_TRACKS, SHIFT_COURSES = 3, 3  # with fewer any map fits
CELL_M, COURSES, MAX_CELLS = 4.0, 8, 1500
MOVING_MPS = 2.0  # slower samples tell nothing about lanes
SAMPLE_M = 1.0
MAX_SAMPLES = 2000  # more are thinned out evenly
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Poses of moving vehicles, one for every metre driven; ``track`` (n,) counts from 0."""

    x: FloatArray
    y: FloatArray
    heading: FloatArray
    track: IntArray

    @property
    def tracks(self) -> int:
        """Number of tracks."""
        return int(self.track.max(initial=-1)) + 1

    def take(self, keep: BoolArray) -> Evidence:
        """Return the samples where ``keep`` (n,) is True."""
        number = np.unique(self.track[keep], return_inverse=True)[1].astype(np.int64)
        return Evidence(x=self.x[keep], y=self.y[keep], heading=self.heading[keep], track=number)


def evidence(rows: TrackRows) -> Evidence:
    """Return one pose for every metre that vehicles drive."""
    joined = np.diff(rows.segment) == 0
    step = np.where(joined, np.hypot(np.diff(rows.x), np.diff(rows.y)), 0.0)
    mark = np.floor(np.append(0.0, np.cumsum(step)) / SAMPLE_M)
    keep = np.append(True, ~joined | (np.diff(mark) > 0.0))[: len(rows)] & (rows.speed > MOVING_MPS)
    return Evidence(x=rows.x, y=rows.y, heading=rows.psi_rad, track=rows.track).take(keep)


def thinned(samples: Evidence, most: int = MAX_SAMPLES) -> Evidence:
    """Return at most so many samples, evenly taken."""
    if len(samples.x) <= most:
        return samples
    chosen = np.zeros(len(samples.x), bool)
    chosen[np.linspace(0, len(samples.x) - 1, most).astype(np.int64)] = True
    return samples.take(chosen)


def on_lanes(samples: Evidence, road: Road) -> float:
    """Return the share of samples that match a lane; 1 without samples."""
    few = thinned(samples, most=400)
    return len(match(road, few.x, few.y, few.heading).best) / len(few.x) if len(few.x) else 1.0


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
    bins = np.bincount(np.floor(pooled.heading / (np.pi / 8.0)).astype(np.int64) % 16, minlength=16)
    main = (np.argmax(bins) + 0.5) * np.pi / 8.0
    if (np.abs(wrap(pooled.heading - main)) > np.pi / 4.0).mean() < MIN_OTHER_DIRECTIONS:
        return table, ()
    fit = _fit(pooled, road)
    before, after = (_matched(pooled, road, one)[4] for one in (_Alignment(centre=fit.centre), fit))
    if not _is_certain(fit, pooled, road, before):
        return table, ()
    others = f", estimated from {len(parts)} recordings of the site" if len(parts) > 1 else ""
    finding = (
        f"tracks aligned to the map: dx {fit.dx:+.2f} m, dy {fit.dy:+.2f} m, rotation "
        f"{math.degrees(fit.turn):+.2f} degrees (median distance to lane centre "
        f"{np.median(np.abs(before)):.2f} -> {np.median(np.abs(after)):.2f} m{others})"
    )
    vehicles, rest = fit.moved(table.vehicles), fit.moved(table.others)
    return replace(table, vehicles=vehicles, others=rest), (finding,)


def fitted(samples: Evidence, road: Road) -> tuple[Evidence, float, float]:
    """Return samples moved onto the lanes near them, and the shift dx, dy, m."""
    few = thinned(samples)
    fit = _fit(few, road)
    x, y = fit.points(few.x, few.y)
    return replace(few, x=x, y=y, heading=few.heading + fit.turn), fit.dx, fit.dy


def _pooled(parts: Sequence[Evidence]) -> Evidence:
    begins = np.cumsum([0, *(part.tracks for part in parts)])
    x, y, heading = (np.concatenate([getattr(p, name) for p in parts]) for name in ("x", "y", "heading"))
    track = np.concatenate([part.track + n for part, n in zip(parts, begins[:-1], strict=True)])
    return Evidence(x=x, y=y, heading=heading, track=track)


@dataclass(frozen=True, kw_only=True)
class _Alignment:
    """Shift in m, and turn about a centre in rad, that put tracks onto lanes."""

    centre: tuple[float, float]
    dx: float = 0.0
    dy: float = 0.0
    turn: float = 0.0

    def points(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        c, s = math.cos(self.turn), math.sin(self.turn)
        rx, ry = x - self.centre[0], y - self.centre[1]
        return self.centre[0] + c * rx - s * ry + self.dx, self.centre[1] + s * rx + c * ry + self.dy

    def moved(self, rows: TrackRows) -> TrackRows:
        x, y = self.points(rows.x, rows.y)
        return rows.turned(self.turn).with_columns(x=x, y=y)


def _is_certain(fit: _Alignment, samples: Evidence, road: Road, before: FloatArray) -> bool:
    """Whether an offset is large, and fits tracks that it was not estimated from, too."""
    x, y = fit.points(samples.x, samples.y)
    across = (y - samples.y) * np.cos(samples.heading) - (x - samples.x) * np.sin(samples.heading)
    if float(np.median(np.abs(across))) < MIN_OFFSET_M or math.hypot(fit.dx, fit.dy) > MAX_OFFSET_M:
        return False
    even: BoolArray = samples.track % 2 == 0
    halves = [(samples.take(half), samples.take(~half)) for half in (even, ~even)]
    unseen = np.concatenate([_matched(other, road, _fit(half, road))[4] for half, other in halves])
    return _spread(unseen) <= (1.0 - MIN_GAIN) * _spread(before)


def _fit(samples: Evidence, road: Road) -> _Alignment:
    centre = float(samples.x.mean()), float(samples.y.mean())
    fit, habit = _Alignment(centre=centre), 0.0
    prior = np.diag([s**-2.0 for s in (SHIFT_SIGMA_M, SHIFT_SIGMA_M, TURN_SIGMA_RAD, LANE_SIGMA_M)])
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
    """Return moved points, and heading of the lane, index and offset of those that match one."""
    x, y = alignment.points(samples.x, samples.y)
    heading = wrap(samples.heading + alignment.turn)
    found = match(road, x, y, heading)
    sample = found.vehicle[found.best]
    return x, y, heading[sample] - found.heading_error[found.best], sample, found.offset[found.best]


def _spread(offsets: FloatArray) -> float:
    return float(np.median(np.abs(offsets - np.median(offsets)))) if len(offsets) else math.inf


def explain_off_lanes(
    scene: SeedScene, off: list[int], samples: Evidence, road: Road, *, simulated: bool
) -> TrackError:
    """Error about the vehicles of a seed scene that are ``off`` the lanes."""
    now = scene.now
    here = Evidence(x=now.x[off], y=now.y[off], heading=now.heading[off], track=np.arange(len(off)))
    share, doubt = on_lanes(samples, road), None if simulated else doubt_place(samples, road)
    if closed := on_closed_lanes(here, road):
        why = f"{closed}, or choose another moment with --time S"
    elif simulated:
        why = "the simulation has them beside the lanes for cars; choose another moment with --time S"
    elif doubt is None and len(samples.x) and share >= MIN_SHARE_ON_LANES:
        why = f"though {share:.0%} of the recording's driving is; choose another moment with --time S"
    else:
        why = doubt.removeprefix("warning: ") if doubt else explain_mismatch(samples, road)
    forced = "; read_seed(..., force=True) runs it all the same" if len(off) < scene.vehicles else ""
    beside = f"{len(off)} of {scene.vehicles} vehicles are on no mapped lane of their direction"
    return TrackError(f"{scene.name}: {beside}; {why}{forced}")


def on_closed_lanes(samples: Evidence, road: Road) -> str | None:
    """Return a phrase with the remedy if most samples lie on lanes that the map closes to cars."""
    lanes = {i: replace(lane, kind="vehicle") for i, lane in road.lanes.items() if lane.kind != "vehicle"}
    few = thinned(samples, most=400)
    matches = match(replace(road, lanes=lanes), few.x, few.y, few.heading)
    if 2 * len(np.unique(matches.vehicle)) <= len(few.x):
        return None
    names = sorted({lanes[int(i)].subtype or str(i) for i in matches.lane_id})
    return f"they are on lanes that the map closes to cars: {listed(names)}; allow cars there"


def explain_mismatch(samples: Evidence, road: Road) -> str:
    """Explain why tracks do not lie on a map's lanes: a phrase with the remedy.

    If one shift puts all tracks onto lanes, the origin is wrong; else the map is of another site.
    """
    wrong = f"the map's origin is not the recording's (used: {road.origin[0]:g},{road.origin[1]:g})"
    remedy = "give --origin LAT,LON"
    if road.net is not None:  # its coordinates are fixed
        wrong, remedy = "the map's coordinates are not the recording's", "give the map of these tracks"
    shift = _find_shift(samples, road)
    if shift is None:
        return f"{wrong}, or the map is another site's; {remedy}"
    dx, dy, share = shift
    if share >= FITTING_SHARE:
        moved = f"moved by {dx:+.0f} m, {dy:+.0f} m, {share:.0%} of its driving is on lanes"
        return f"{wrong}: {moved}; {remedy}"
    return "no other origin puts them on lanes, so the tracks belong to another map; give that map"


def doubt_place(samples: Evidence, road: Road) -> str | None:
    """Return a warning if tracks lie beside the lanes and a shift of over 2 m puts more onto lanes."""
    share = on_lanes(samples, road)
    if share > 1.0 - DOUBT_GAIN:
        return None
    shift = _find_shift(samples, road)
    if shift is None or shift[2] - share < DOUBT_GAIN or np.hypot(*shift[:2]) <= MIN_SHIFT_M:
        return None
    (dx, dy, after), (lat, lon) = shift, road.origin
    place = lat + dy / EARTH_M, lon + dx / EARTH_M / np.cos(np.deg2rad(lat))
    near = f"; one near {place[0]:.5f},{place[1]:.5f} fits better" if (lat, lon) != (0.0, 0.0) else ""
    return (
        f"warning: only {share:.0%} of where the vehicles drive is on lanes; moved by {dx:+.0f} m, "
        f"{dy:+.0f} m it is {after:.0%}: check the map's origin ({lat:.5f},{lon:.5f}){near}"
    )


def _find_shift(samples: Evidence, road: Road) -> tuple[float, float, float] | None:
    """Return the shift dx, dy, m, that puts most samples onto lanes, and their share on lanes then.

    None with too few tracks or directions, which fit any map.
    """
    if samples.tracks < SHIFT_TRACKS or len(np.unique(_course(samples.heading))) < SHIFT_COURSES:
        return None
    shift = _best_shift(samples, road)
    if shift is None:
        return None
    moved, dx, dy = fitted(replace(samples, x=samples.x + shift[0], y=samples.y + shift[1]), road)
    return shift[0] + dx, shift[1] + dy, on_lanes(moved, road)


def _course(heading: FloatArray) -> FloatArray:
    return np.asarray(np.rint(wrap(heading) / (2.0 * np.pi / COURSES)) % COURSES)


def _best_shift(samples: Evidence, road: Road) -> tuple[float, float] | None:
    from scipy.signal import fftconvolve

    lanes = []
    for line in (lane.centreline for lane in road.vehicle_lanes.values() if len(lane.centreline) > 1):
        arc = arc_lengths(line)
        s = np.arange(0.0, arc[-1], CELL_M / 2.0)
        segment = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(line) - 2)
        heading = np.arctan2(*np.diff(line, axis=0)[segment].T[::-1])
        lanes.append(np.column_stack((along(line, s), heading)))
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
