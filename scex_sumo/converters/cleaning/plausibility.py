"""Plausibility of a recording as a whole: speeds, headings, accelerations, noise, sizes, doubled vehicles.

Measured before repairs, over strides of one second, which the noise of single samples hardly changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.cleaning.checks import Check, twice
from scex_sumo.converters.cleaning.heading import SIDEWAYS_RAD
from scex_sumo.converters.cleaning.motion import position_noise
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.converters.tracks.rows import FORWARD_MPS, TrackRows, number_of
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.scene import STEP_S

STRIDE_S = 1.0
MIN_STRIDES = 3  # with less nothing is judged
PATH_M = 5.0  # of a judged track
FACTOR = 1.15  # by which speeds of positions and velocities may differ
STEP_FITS = 0.05  # relative
FITS_RAD = np.deg2rad(15.0)  # of what explains turned headings
SOME_TURNED, MOST_TURNED = 0.2, 0.5  # shares of the driving
TYRES_MPS2 = 9.8
NOISE_M = 0.3
LIMITS = 1.5  # of the median speed
MATCHED = 500  # strides that are matched to lanes
# Median lengths and widths, m, that recordings of real vehicles stay well within.
SIZES_M: Mapping[str, tuple[float, float, float, float]] = {
    "car": (2.8, 7.5, 1.3, 2.7),
    "van": (3.5, 9.0, 1.5, 3.2),
    "motorcycle": (1.2, 3.5, 0.4, 1.3),
    "bus": (4.5, 30.0, 1.7, 3.6),
    "truck": (3.5, 30.0, 1.5, 4.0),
    "tram": (8.0, 80.0, 1.8, 3.6),
}
ANY_SIZE_M = (1.2, 80.0, 0.4, 4.5)
MIN_OF_KIND = 3  # fewer are judged as any vehicle
CAR_M = (4.6, 1.85)
SHRUNK, NEAR_M = 0.8, 12.0  # of boxes that are tried: those of a queue do not touch
GRID_S, DOUBLED_TIMES, DOUBLED_SHARE = 0.5, 3, 0.8

_VELOCITIES = "velocities of"  # begins what repairs say about them


def plausibility(rows: TrackRows, road: Road | None = None) -> tuple[Check, ...]:
    """Check a recording of vehicles as it was read; the limits only with a ``road``."""
    if not len(rows):
        return ()
    strides = _Strides.of(rows)
    sizes = _sizes(rows)
    return (
        _speeds(strides),
        *(() if road is None else (_limits(strides, road),)),
        _headings(strides),
        _accelerations(strides),
        _noise(rows),
        sizes,
        *(() if sizes.verdict == "error" else (_doubles(rows),)),  # boxes that are too large overlap
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Strides:
    """Strides (n,) of about one second, one after the other.

    Attributes:
        rows: the recording.
        step_s: usual time between samples.
        first: row where it begins.
        next: whether the following stride is the same track's and begins where this one ends.
        moved: (n, 2) by the positions, m; ``said`` by the velocities.
    """

    rows: TrackRows
    step_s: float
    first: IntArray
    middle: IntArray
    next: BoolArray
    seconds: FloatArray
    moved: FloatArray
    said: FloatArray

    @classmethod
    def of(cls, rows: TrackRows) -> _Strides:
        time_s = rows.timestamp_ms / 1000.0
        step_s = np.diff(time_s)
        within = (np.diff(rows.segment) == 0) & (step_s > 0.0)
        usual = float(np.median(step_s[within])) if within.any() else STEP_S
        reach = max(1, round(STRIDE_S / max(usual, 1e-3)))
        since = np.arange(len(rows)) - rows.pieces[0][rows.piece]
        first = np.flatnonzero(since[: max(len(rows) - reach, 0)] % reach == 0)
        first = first[rows.segment[first] == rows.segment[first + reach]]
        last = first + reach
        first, last = (ends[time_s[last] > time_s[first]] for ends in (first, last))
        velocity = np.stack((rows.vx, rows.vy), axis=1)
        areas = (velocity[1:] + velocity[:-1]) / 2.0 * step_s[:, None]
        driven = np.vstack((np.zeros((1, 2)), np.cumsum(areas, axis=0)))
        places = np.stack((rows.x, rows.y), axis=1)
        return cls(
            rows=rows,
            step_s=usual,
            first=first,
            middle=(first + last) // 2,
            next=np.append(last[:-1] == first[1:], False)[: len(first)],
            seconds=time_s[last] - time_s[first],
            moved=places[last] - places[first],
            said=driven[last] - driven[first],
        )

    @property
    def speed(self) -> FloatArray:
        return np.asarray(np.hypot(*self.moved.T) / self.seconds)

    @property
    def driving(self) -> BoolArray:
        return np.asarray(self.speed > FORWARD_MPS)

    @property
    def course(self) -> FloatArray:
        return np.arctan2(self.moved[:, 1], self.moved[:, 0])


def _speeds(strides: _Strides) -> Check:
    check = Check(
        name="speed of positions / of velocities", value="-", usual=f"{1 / FACTOR:.2f} to {FACTOR:.2f}"
    )
    track, tracks = strides.rows.track[strides.first], strides.rows.tracks
    moved, said = (np.bincount(track, np.hypot(*way.T), tracks) for way in (strides.moved, strides.said))
    judged = np.maximum(moved, said) > PATH_M
    if not judged.any():
        return check
    factor = float(np.median(moved[judged] / np.maximum(said[judged], 1e-3)))
    check = replace(check, value=f"{factor:.2f}")
    if 1 / FACTOR <= factor <= FACTOR:
        return check
    if abs(factor * strides.step_s / STEP_S - 1.0) < STEP_FITS:
        problem = (
            f"time stamps are probably wrong: velocities and positions fit if a step lasts {STEP_S:g} s, not "
            f"{strides.step_s:g} s; multiply the stamps by {factor:.3g}"
        )
        return replace(check, verdict="warning", problem=problem, explains=_VELOCITIES)
    problem = f"velocities do not fit the positions ({factor:.2f} x), which are taken"
    return replace(check, verdict="repaired", problem=problem)


def _limits(strides: _Strides, road: Road) -> Check:
    check = Check(name="speed / speed limit, median", value="-", usual=f"up to {LIMITS:g}")
    chosen = np.flatnonzero(strides.driving)
    chosen = (
        chosen[np.unique(np.linspace(0, len(chosen) - 1, MATCHED).astype(int))] if len(chosen) else chosen
    )
    at = strides.middle[chosen]
    matches = match(road, strides.rows.x[at], strides.rows.y[at], strides.course[chosen])
    best = np.append(True, np.diff(matches.vehicle) != 0)[: len(matches.vehicle)]
    limit = np.array([road.lanes[int(i)].speed_limit_mps for i in matches.lane_id[best]])
    if len(limit) < MIN_STRIDES:
        return check
    share = float(np.median(strides.speed[chosen][matches.vehicle[best]] / limit))
    check = replace(check, value=f"{share:.2f}")
    if share <= LIMITS:
        return check
    problem = (
        f"half of the driving is over {share:.1f} x the speed limit: time stamps, or the unit of positions "
        "or limits, are probably wrong"
    )
    return replace(check, verdict="warning", problem=problem)


_TURNS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "are turned by 180 degrees, vehicles would drive backwards; add pi": lambda psi: psi + np.pi,
    "are turned by 90 degrees to the left; subtract pi/2": lambda psi: psi - np.pi / 2,
    "are turned by 90 degrees to the right; add pi/2": lambda psi: psi + np.pi / 2,
    "are compass headings (0 = north, clockwise); give pi/2 - heading": lambda psi: np.pi / 2 - psi,
    "count clockwise; change their sign": lambda psi: -psi,
    "are in degrees; give radians": np.deg2rad,
    "are compass headings in degrees; give pi/2 - heading in radians": lambda psi: (
        np.pi / 2 - np.deg2rad(psi)
    ),
}


def _headings(strides: _Strides) -> Check:
    check = Check(name="driving with heading over 45° off", value="-", usual=f"up to {SOME_TURNED:.0%}")
    driving = strides.driving
    if driving.sum() < MIN_STRIDES:
        return check
    psi, course = strides.rows.psi_rad[strides.middle][driving], strides.course[driving]
    turned = float((np.abs(wrap(psi - course)) > SIDEWAYS_RAD).mean())
    check = replace(check, value=f"{turned:.0%}")
    if turned <= SOME_TURNED:
        return check
    off = {cause: float(np.median(np.abs(wrap(right(psi) - course)))) for cause, right in _TURNS.items()}
    cause = min(off, key=lambda words: off[words])
    if turned > MOST_TURNED and off[cause] < FITS_RAD:
        return replace(check, verdict="error", problem=f"headings {cause}")
    problem = (
        f"headings of {turned:.0%} of the driving contradict the motion: of slow vehicles they stay wrong"
    )
    return replace(check, verdict="warning", problem=problem)


def _accelerations(strides: _Strides) -> Check:
    check = Check(name="acceleration, 99 % within, m/s²", value="-", usual=f"up to {TYRES_MPS2:g}")
    here = np.flatnonzero(strides.next)
    if len(here) < MIN_STRIDES:
        return check
    velocity = strides.moved / strides.seconds[:, None]
    change = np.hypot(*(velocity[here + 1] - velocity[here]).T) / strides.seconds[here]
    most = float(np.percentile(change, 99.0))
    check = replace(check, value=f"{most:.1f}")
    if most <= TYRES_MPS2:
        return check
    problem = (
        f"accelerations reach {most:.0f} m/s², more than tyres can do: time stamps, or the unit of "
        "positions, are probably wrong"
    )
    return replace(check, verdict="warning", problem=problem)


def _noise(rows: TrackRows) -> Check:
    noise = position_noise(np.stack((rows.x, rows.y), axis=1), rows.timestamp_ms / 1000.0, rows.segment)
    check = Check(name="noise of positions, m", value=f"{noise:.2f}", usual=f"up to {NOISE_M:g}")
    if noise <= NOISE_M:
        return check
    problem = (
        f"positions scatter by {noise:.1f} m from sample to sample: a run begins with other speeds and "
        "distances than the traffic had; take the tracks of a better tracker"
    )
    return replace(check, verdict="warning", problem=problem, explains=_VELOCITIES)


def _sizes(rows: TrackRows) -> Check:
    first = np.searchsorted(rows.track, np.arange(rows.tracks))
    length, width = rows.length[first], rows.width[first]
    kinds = np.array([road_user(kind) for kind in rows.types])
    main = max(set(kinds.tolist()), key=lambda kind: (int((kinds == kind).sum()), kind))
    shown = kinds == main
    value = f"{main} {np.median(length[shown]):.1f} x {np.median(width[shown]):.1f}"
    low, high, thin, wide = SIZES_M[main]
    usual = f"{low:g} to {high:g} x {thin:g} to {wide:g}"
    problems = []
    for kind in np.unique(kinds).tolist():
        of_kind = kinds == kind
        few = of_kind.sum() < MIN_OF_KIND
        sizes = float(np.median(length[of_kind])), float(np.median(width[of_kind]))
        low, high, thin, wide = ANY_SIZE_M if few else SIZES_M.get(kind, ANY_SIZE_M)
        if not (low <= sizes[0] <= high and thin <= sizes[1] <= wide):
            problems.append(
                f"{kind}s are {sizes[0]:.2g} m long and {sizes[1]:.2g} m wide{_why(kind, *sizes)}"
            )
    return Check(
        name="sizes, m, median",
        value=value,
        usual=usual,
        verdict="error" if problems else "",
        problem=", ".join(problems),
    )


def _why(kind: str, length: float, width: float) -> str:
    if width > length:
        return ": length and width are swapped"
    factors = length / CAR_M[0], width / CAR_M[1]
    if kind != "car" or max(factors) > 1.3 * min(factors):
        return ""
    factor = float(np.sqrt(factors[0] * factors[1]))
    remedy = "give metres, not feet" if 3.0 < factor < 3.6 else "repair the sizes"
    return f", {factor:.2g} x the usual size: {remedy}"


def _doubles(rows: TrackRows) -> Check:
    stamps = rows.stamps_ms
    slots = np.unique(np.floor(stamps / (1000.0 * GRID_S)), return_index=True)[1]
    at = np.flatnonzero(np.isin(rows.timestamp_ms, stamps[slots]))
    pairs = _near_pairs(rows, at)
    one, two = (_boxes(rows, at[k]) for k in pairs.T)
    tracks = np.sort(rows.track[at[pairs[separation(one, two) < 0.0]]], axis=1)
    tracks = tracks[tracks[:, 0] != tracks[:, 1]]  # samples recorded twice are repaired
    doubles, times = np.unique(tracks, axis=0, return_counts=True)
    doubled = []
    for (a, b), count in zip(doubles.tolist(), times.tolist(), strict=True):
        here, there = (rows.timestamp_ms[at[rows.track[at] == k]] for k in (a, b))
        if count >= max(DOUBLED_TIMES, DOUBLED_SHARE * len(np.intersect1d(here, there))):
            doubled.append((str(number_of(rows.labels[a])), str(number_of(rows.labels[b]))))
    return Check(
        name="vehicles within another one",
        value=str(len(doubled)),
        usual="0",
        verdict="warning" if doubled else "",
        problem=twice(doubled),
        pairs=tuple(doubled),
    )


def _near_pairs(rows: TrackRows, at: IntArray) -> IntArray:
    """Return (m, 2) pairs of samples ``at`` the same time and less than `NEAR_M` apart."""
    moments = np.stack((rows.case[at], rows.timestamp_ms[at]), axis=1)
    moment = np.unique(moments, axis=0, return_inverse=True)[1].reshape(-1)
    apart = np.ptp(rows.x[at]) + 2.0 * NEAR_M  # moments lie beside each other
    points = shapely.points(rows.x[at] + apart * moment, rows.y[at])
    pairs = shapely.STRtree(points).query(points, predicate="dwithin", distance=NEAR_M)
    return np.asarray(pairs[:, pairs[0] < pairs[1]].T, np.int64)


def _boxes(rows: TrackRows, at: IntArray) -> Rectangles:
    return Rectangles(
        x=rows.x[at],
        y=rows.y[at],
        heading=rows.psi_rad[at],
        half_length=SHRUNK * rows.length[at] / 2,
        half_width=SHRUNK * rows.width[at] / 2,
    )
