"""Plausibility of a recording as a whole: speeds, headings, accelerations, noise, sizes, doubled vehicles.

Measured before repairs, over strides of one second, which the noise of single samples hardly changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError, listed
from scex_sumo.converters.cleaning.motion import SIDEWAYS_RAD, position_noise
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.converters.tracks.rows import FORWARD_MPS, TrackRows, TrackTable, number_of
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

SOME_LOST, MOST_LOST = 0.1, 0.5  # shares of the vehicles
Verdict = Literal["", "repaired", "warning", "error"]


@dataclass(frozen=True)
class Check:
    """One row of the table.

    Attributes:
        value: what was measured; ``-`` if the recording has too little for it.
        usual: what is plausible.
        problem: what is wrong, the likely cause and the remedy; empty if plausible.
        verdict: ``repaired``: the reader does so; ``error``: a run would mean nothing; empty if plausible.
        pairs: track ids of vehicles that are recorded twice; the problem is only theirs.
        explains: whether the problem is the true cause of velocities that contradict the motion.
    """

    name: str
    value: str
    usual: str
    problem: str = ""
    verdict: Verdict = "warning"
    pairs: tuple[tuple[str, str], ...] = ()
    explains: bool = False

    def __post_init__(self) -> None:
        if not self.problem:
            object.__setattr__(self, "verdict", "")
            object.__setattr__(self, "explains", False)


def refuse_implausible(name: object, checks: Sequence[Check], remedy: str) -> None:
    """Raise a `TrackError` for the checks after which a run means nothing."""
    if wrong := [check.problem for check in checks if check.verdict == "error"]:
        raise TrackError(f"{name}: {'; '.join(wrong)}; {remedy}")


def lost_vehicles(before: TrackTable, after: TrackTable) -> Check:
    """Judge how many vehicles of a recording its repairs leave out."""
    vehicles, lost = before.vehicles.tracks, before.vehicles.tracks - after.vehicles.tracks
    share = lost / max(vehicles, 1)
    problem = f"repairs leave out {lost} of {vehicles} vehicles: mend the tracks" if share > SOME_LOST else ""
    name, usual = "vehicles left out by repairs", f"up to {SOME_LOST:.0%}"
    return Check(name, f"{share:.0%}", usual, problem, "error" if share > MOST_LOST else "warning")


def doubts(checks: Sequence[Check], present: Iterable[object] = ()) -> tuple[str, ...]:
    """Return a warning for each check that neither passed nor is repaired; of pairs those ``present``."""
    warnings, names = [], set(map(str, present))
    for check in checks:
        problem = check.problem
        if check.pairs:
            problem = twice([pair for pair in check.pairs if set(pair) <= names])
        if problem and check.verdict != "repaired":
            warnings.append(f"warning: {problem}")
    return tuple(warnings)


def without_explained(findings: Sequence[str], checks: Sequence[Check]) -> tuple[str, ...]:
    """Leave out phrases about repaired velocities if a check names the true cause."""
    explained = any(check.explains for check in checks)
    return tuple(finding for finding in findings if not (explained and finding.startswith("velocities of")))


def twice(pairs: Sequence[tuple[str, str]]) -> str:
    """Return the problem of vehicles that are recorded twice; empty without any."""
    names = listed(f"{a} and {b}" for a, b in pairs)
    why = "overlap all the time: probably one vehicle recorded twice; leave one out"
    return f"tracks {names} {why}" if pairs else ""


def plausibility(rows: TrackRows, road: Road | None = None) -> tuple[Check, ...]:
    """Check a recording of vehicles as it was read; the limits only with a ``road``."""
    if not len(rows):
        return ()
    strides = _strides(rows)
    checks = [_speeds(strides), _headings(strides), _accelerations(strides), _noise(rows), _sizes(rows)]
    if road is not None:
        checks.insert(1, _limits(strides, road))
    # Boxes that are too large overlap.
    return (*checks, *(() if checks[-1].verdict == "error" else (_doubles(rows),)))


class _Strides(NamedTuple):
    """Strides (n,) of about one second, one after the other.

    Attributes:
        step_s: usual time between samples.
        first: row where it begins.
        next: whether the following stride is the same track's and begins where this one ends.
        moved: (n, 2) by the positions, m; ``integrated`` by the velocities.
    """

    rows: TrackRows
    step_s: float
    first: IntArray
    middle: IntArray
    next: BoolArray
    seconds: FloatArray
    moved: FloatArray
    integrated: FloatArray
    speed: FloatArray
    course: FloatArray


def _strides(rows: TrackRows) -> _Strides:
    time_s = rows.timestamp_ms / 1000.0
    step_s = np.diff(time_s)
    within = (np.diff(rows.segment) == 0) & (step_s > 0.0)
    usual = float(np.median(step_s[within])) if within.any() else STEP_S
    reach = max(1, round(STRIDE_S / max(usual, 1e-3)))
    since = np.arange(len(rows)) - rows.pieces[0][rows.piece]
    first = np.flatnonzero(since[: max(len(rows) - reach, 0)] % reach == 0)
    first = first[rows.segment[first] == rows.segment[first + reach]]
    first = first[time_s[first + reach] > time_s[first]]
    last = first + reach
    velocity = np.stack((rows.vx, rows.vy), axis=1)
    areas = (velocity[1:] + velocity[:-1]) / 2.0 * step_s[:, None]
    driven = np.vstack((np.zeros((1, 2)), np.cumsum(areas, axis=0)))
    places = np.stack((rows.x, rows.y), axis=1)
    moved, seconds = places[last] - places[first], time_s[last] - time_s[first]
    speed, course = np.hypot(*moved.T) / seconds, np.arctan2(moved[:, 1], moved[:, 0])
    after = np.append(last[:-1] == first[1:], False)[: len(first)]
    middle, integrated = (first + last) // 2, driven[last] - driven[first]
    return _Strides(rows, usual, first, middle, after, seconds, moved, integrated, speed, course)


def _speeds(strides: _Strides) -> Check:
    name, usual = "speed of positions / of velocities", f"{1 / FACTOR:.2f} to {FACTOR:.2f}"
    track, count = strides.rows.track[strides.first], strides.rows.tracks
    moved, integrated = (
        np.bincount(track, np.hypot(*vectors.T), count) for vectors in (strides.moved, strides.integrated)
    )
    judged = np.maximum(moved, integrated) > PATH_M
    if not judged.any():
        return Check(name, "-", usual)
    factor = float(np.median(moved[judged] / np.maximum(integrated[judged], 1e-3)))
    if 1 / FACTOR <= factor <= FACTOR:
        return Check(name, f"{factor:.2f}", usual)
    if abs(factor * strides.step_s / STEP_S - 1.0) < STEP_FITS:
        problem = (
            f"time stamps are probably wrong: velocities and positions fit if a step lasts {STEP_S:g} s, not "
            f"{strides.step_s:g} s; multiply the stamps by {factor:.3g}"
        )
        return Check(name, f"{factor:.2f}", usual, problem, explains=True)
    problem = f"velocities do not fit the positions ({factor:.2f} x), which are taken"
    return Check(name, f"{factor:.2f}", usual, problem, "repaired")


def _limits(strides: _Strides, road: Road) -> Check:
    chosen = np.flatnonzero(strides.speed > FORWARD_MPS)
    if len(chosen):
        chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, MATCHED).astype(int))]
    samples = strides.middle[chosen]
    matches = match(road, strides.rows.x[samples], strides.rows.y[samples], strides.course[chosen])
    limit = np.array([road.lanes[int(i)].speed_limit_mps for i in matches.lane_id[matches.best]])
    few = len(limit) < MIN_STRIDES
    share = 0.0 if few else float(np.median(strides.speed[chosen][matches.vehicle[matches.best]] / limit))
    problem = (
        f"half of the driving is over {share:.1f} x the speed limit: time stamps, or the unit of positions "
        "or limits, are probably wrong"
    )
    name, value = "speed / speed limit, median", "-" if few else f"{share:.2f}"
    return Check(name, value, f"up to {LIMITS:g}", problem if share > LIMITS else "")


_TURNS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "are turned by 180 degrees, vehicles would drive backwards; add pi": lambda psi: psi + np.pi,
    "are turned by 90 degrees to the left; subtract pi/2": lambda psi: psi - np.pi / 2,
    "are turned by 90 degrees to the right; add pi/2": lambda psi: psi + np.pi / 2,
    "are compass headings (0 = north, clockwise); give pi/2 - heading": lambda psi: np.pi / 2 - psi,
    "count clockwise; change their sign": lambda psi: -psi,
    "are in degrees; give radians": np.deg2rad,
    "are compass headings in degrees; give pi/2 - heading in radians": lambda d: np.pi / 2 - np.deg2rad(d),
}


def _headings(strides: _Strides) -> Check:
    name, usual = "driving with heading over 45° off", f"up to {SOME_TURNED:.0%}"
    driving = strides.speed > FORWARD_MPS
    if driving.sum() < MIN_STRIDES:
        return Check(name, "-", usual)
    psi, course = strides.rows.psi_rad[strides.middle][driving], strides.course[driving]
    turned = float((np.abs(wrap(psi - course)) > SIDEWAYS_RAD).mean())
    if turned > MOST_TURNED:
        errors = {cause: np.median(np.abs(wrap(mended(psi) - course))) for cause, mended in _TURNS.items()}
        cause = min(errors, key=errors.__getitem__)
        if errors[cause] < FITS_RAD:
            return Check(name, f"{turned:.0%}", usual, f"headings {cause}", "error")
    problem = (
        f"headings of {turned:.0%} of the driving contradict the motion: of slow vehicles they stay wrong"
    )
    return Check(name, f"{turned:.0%}", usual, problem if turned > SOME_TURNED else "")


def _accelerations(strides: _Strides) -> Check:
    followed = np.flatnonzero(strides.next)
    few = len(followed) < MIN_STRIDES
    velocity = strides.moved / strides.seconds[:, None]
    change = np.hypot(*(velocity[followed + 1] - velocity[followed]).T) / strides.seconds[followed]
    highest = 0.0 if few else float(np.percentile(change, 99.0))
    problem = (
        f"accelerations reach {highest:.0f} m/s², more than tyres can do: time stamps, or the unit of "
        "positions, are probably wrong"
    )
    name, value = "acceleration, 99 % within, m/s²", "-" if few else f"{highest:.1f}"
    return Check(name, value, f"up to {TYRES_MPS2:g}", problem if highest > TYRES_MPS2 else "")


def _noise(rows: TrackRows) -> Check:
    noise = position_noise(rows)
    problem = (
        f"positions scatter by {noise:.1f} m from sample to sample: a run begins with other speeds and "
        "distances than the traffic had; take the tracks of a better tracker"
    )
    name, usual = "noise of positions, m", f"up to {NOISE_M:g}"
    return Check(name, f"{noise:.2f}", usual, problem if noise > NOISE_M else "", explains=True)


def _sizes(rows: TrackRows) -> Check:
    first = np.searchsorted(rows.track, np.arange(rows.tracks))
    kinds = np.array([road_user(kind) for kind in rows.types])
    names, counts = np.unique(kinds, return_counts=True)
    main = max(zip(counts.tolist(), names.tolist(), strict=True))[1]
    problems, value = [], ""
    for kind in names.tolist():
        of_kind = kinds == kind
        length, width = (float(np.median(sizes[first][of_kind])) for sizes in (rows.length, rows.width))
        if kind == main:
            value = f"{main} {length:.1f} x {width:.1f}"
        few = of_kind.sum() < MIN_OF_KIND
        low, high, thin, wide = ANY_SIZE_M if few else SIZES_M.get(kind, ANY_SIZE_M)
        if not (low <= length <= high and thin <= width <= wide):
            problems.append(
                f"{kind}s are {length:.2g} m long and {width:.2g} m wide{_why(kind, length, width)}"
            )
    low, high, thin, wide = SIZES_M[main]
    usual = f"{low:g} to {high:g} x {thin:g} to {wide:g}"
    return Check("sizes, m, median", value, usual, ", ".join(problems), "error")


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
    samples = np.flatnonzero(np.isin(rows.timestamp_ms, stamps[slots]))
    pairs = _near_pairs(rows, samples)
    first, second = (_boxes(rows, samples[k]) for k in pairs.T)
    tracks = np.sort(rows.track[samples[pairs[separation(first, second) < 0.0]]], axis=1)
    tracks = tracks[tracks[:, 0] != tracks[:, 1]]  # samples recorded twice are repaired
    doubles, times = np.unique(tracks, axis=0, return_counts=True)
    doubled = []
    for (a, b), count in zip(doubles.tolist(), times.tolist(), strict=True):
        stamps_a, stamps_b = (rows.timestamp_ms[samples[rows.track[samples] == k]] for k in (a, b))
        if count >= max(DOUBLED_TIMES, DOUBLED_SHARE * len(np.intersect1d(stamps_a, stamps_b))):
            doubled.append((str(number_of(rows.labels[a])), str(number_of(rows.labels[b]))))
    name = "vehicles within another one"
    return Check(name, str(len(doubled)), "0", twice(doubled), pairs=tuple(doubled))


def _near_pairs(rows: TrackRows, samples: IntArray) -> IntArray:
    """Return (m, 2) pairs of ``samples`` at the same time and less than `NEAR_M` apart."""
    moments = np.stack((rows.case[samples], rows.timestamp_ms[samples]), axis=1)
    moment = np.unique(moments, axis=0, return_inverse=True)[1].reshape(-1)
    apart = np.ptp(rows.x[samples]) + 2.0 * NEAR_M  # moments lie beside each other
    points = shapely.points(rows.x[samples] + apart * moment, rows.y[samples])
    pairs = shapely.STRtree(points).query(points, predicate="dwithin", distance=NEAR_M)
    return np.asarray(pairs[:, pairs[0] < pairs[1]].T, np.int64)


def _boxes(rows: TrackRows, samples: IntArray) -> Rectangles:
    sides = {"half_length": SHRUNK * rows.length[samples] / 2, "half_width": SHRUNK * rows.width[samples] / 2}
    return Rectangles(x=rows.x[samples], y=rows.y[samples], heading=rows.psi_rad[samples], **sides)
