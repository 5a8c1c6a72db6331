"""Seed scene of one moment of a recording, whose tracks are sampled on its steps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.cleaning.plausibility import doubts, lost_vehicles
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.datasets.moment import CASE_FRAME, STAMP_MS, busiest, find_moments
from scex_sumo.converters.naming import unique_names
from scex_sumo.converters.tracks.check import MISSING
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, ahead_speed, number_of, other_rate
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Obstacles, SeedScene, States

FUTURE_STEPS = 80
"""Steps of the recorded future that a seed scene keeps."""


def take_scene(
    table: TrackTable,
    findings: tuple[str, ...] = (),
    *,
    name: str,
    location: str,
    case: str | float | None = None,
    time_s: float | None = None,
    repair: bool = True,
) -> SeedScene:
    """Take the seed scene of one moment; see `recorded_scene`.

    Args:
        table: repaired and aligned to the map; cases are only aligned.
        findings: what was repaired.
        repair: whether a case is repaired, too.
    """
    if not len(table.vehicles):
        kinds = ", ".join(sorted(set(table.others.types)))
        reason = f"only {kinds}" if kinds else "none left after repairs"
        raise TrackError(f"{table.path}: no motor vehicle among the tracks ({reason}); give others")
    case_id, warnings = "", tuple[str, ...]()
    if table.has_cases or case is not None:
        from scex_sumo.converters.datasets.cases import choose_case

        index = choose_case(table, case, time_s)
        case_id = table.cases[index]
        table = table.case(index)
        if repair:
            raw = table
            table, case_findings = repair_tracks(raw)
            findings, warnings = (*findings, *case_findings), doubts([lost_vehicles(raw, table)])
    ends = [finding for finding in findings if "known until" in finding]
    moment_ms = _choose_moment(table, case_id, time_s, ends)
    scene = _build(table, name, location, case_id, moment_ms, findings)
    return replace(scene, notes=(*scene.notes, *warnings))


def _choose_moment(table: TrackTable, case_id: str, time_s: float | None, ends: Sequence[str]) -> float:
    """Stamp of the moment, ms: the nearest frame to a time, else the busiest moment.

    Args:
        ends: why the recording does not last longer.
    """
    rows = table.vehicles
    where = f"{table.path}: case {case_id}" if case_id else f"{table.path}"
    if not len(rows):
        raise TrackError(f"{where}: no vehicle (left after repairs); choose another moment")
    if time_s is None:
        if not table.has_cases:
            return 1000.0 * busiest(find_moments(table)).time_s
        case_stamps = rows.timestamp_ms[rows.frame_id == CASE_FRAME]
        if not len(case_stamps):
            raise TrackError(f"{where}: no vehicle in frame {CASE_FRAME}; choose the moment with --time S")
        return float(case_stamps[0])
    stamps = np.concatenate((rows.stamps_ms, table.others.stamps_ms))
    half_ms = 500.0 * table.step_s + STAMP_MS
    begin, end = stamps.min(), stamps.max()
    wanted_ms = 1000.0 * time_s
    if not begin - half_ms <= wanted_ms <= end + half_ms:  # nan, too
        raise TrackError(
            f"{where}: no moment at {time_s:g} s, the recording spans {begin / 1000:.1f} to "
            f"{end / 1000:.1f} s{''.join(f' ({reason})' for reason in ends)}; choose --time in between"
        )
    nearest_ms = float(rows.stamps_ms[np.argmin(np.abs(rows.stamps_ms - wanted_ms))])
    if abs(nearest_ms - wanted_ms) <= half_ms:
        return nearest_ms
    if not len(sample_tracks(rows, wanted_ms, np.array([wanted_ms])).track):
        raise TrackError(
            f"{where}: no vehicle at {time_s:g} s; the nearest moment with one is {nearest_ms / 1000:.1f} s"
        )
    return wanted_ms


def _build(
    table: TrackTable, name: str, location: str, case_id: str, moment_ms: float, findings: tuple[str, ...]
) -> SeedScene:
    steps_ms = 1000.0 * STEP_S * np.arange(-HISTORY_STEPS, FUTURE_STEPS + 1)
    grid_ms: FloatArray = (moment_ms + steps_ms).astype(np.float64)
    rows = table.vehicles
    sampled = sample_tracks(rows, moment_ms, grid_ms)
    steps = sampled.recorded[:, :HISTORY_STEPS].sum(axis=1).astype(np.int64)
    valid, states = sampled.recorded[:, HISTORY_STEPS + 1 :], sampled.states
    ids = [number_of(rows.labels[k]) for k in sampled.track]
    source = {"kind": "tracks", "tracks": str(table.path.absolute()), "time_s": moment_ms / 1000.0}
    if case_id:
        from scex_sumo.converters.datasets.cases import marked_vehicles

        source |= {"case": case_id, **marked_vehicles(table.path, case_id)}
    return SeedScene(
        name=_moment_name(name, case_id, moment_ms),
        location=location,
        time_s=moment_ms / 1000.0,
        track_ids=np.array(ids, np.int64),
        types=tuple(_plain_word(rows.types[k].lower()) for k in sampled.track),
        length=sampled.length,
        width=sampled.width,
        history=states[:, : HISTORY_STEPS + 1],
        recorded_steps=steps,
        future=states[:, HISTORY_STEPS + 1 :] if valid.any() else None,
        future_valid=valid if valid.any() else None,
        obstacles=_obstacles(table.others, moment_ms, grid_ms, vehicles=ids),
        notes=tuple(_notes(table, sampled, steps, moment_ms, findings)),
        source=source,
    )


def _plain_word(text: str) -> str:
    """Return an id or type as it is read back from a file of tracks."""
    word = re.sub(r"[^A-Za-z0-9_.+/: -]", "_", text).strip()
    return f"{word}_" if word in MISSING else word


def _obstacles(
    rows: TrackRows, moment_ms: float, grid_ms: FloatArray, *, vehicles: Sequence[int]
) -> Obstacles | None:
    sampled = sample_tracks(rows, moment_ms, grid_ms)
    if not len(sampled.track):
        return None
    present = sampled.recorded.copy()
    present[:, HISTORY_STEPS:] = True  # after the recording's end they go on at constant velocity
    return Obstacles(
        ids=tuple(unique_names((_plain_word(rows.labels[k]) for k in sampled.track), map(str, vehicles))),
        types=tuple(_plain_word(rows.types[k].lower()) for k in sampled.track),
        length=sampled.length,
        width=sampled.width,
        states=sampled.states,
        present=present,
    )


def _notes(
    table: TrackTable, sampled: Sampled, steps: IntArray, moment_ms: float, findings: tuple[str, ...]
) -> list[str]:
    notes = []
    if findings:
        notes.append(f"{table.path.name} repaired: {'; '.join(findings)}")
    if other_rate(step_s := table.recorded_step_s or table.step_s):
        notes.append(f"recorded at {1 / step_s:.3g} Hz: interpolated to 10 Hz")
    elif sampled.interpolated:
        notes.append(f"{sampled.interpolated} missing samples interpolated")
    earliest = float(table.vehicles.stamps_ms[0])
    available = min(HISTORY_STEPS, int((moment_ms - earliest + STAMP_MS) // (1000.0 * STEP_S)))
    if available < HISTORY_STEPS:
        notes.append(f"{available} of {HISTORY_STEPS} previous steps recorded, constant velocity before")
    short = int((steps < available).sum())
    if short:
        notes.append(
            f"{short} of {len(steps)} vehicles came within the last second: constant velocity before"
        )
    return notes


def _moment_name(name: str, case_id: str, moment_ms: float) -> str:
    time_s = moment_ms / 1000.0
    when = f"{time_s:.1f}" if abs(time_s - round(time_s, 1)) < 1e-6 else f"{time_s:.3f}"
    name += f"_case{case_id}" if case_id else ""
    if not (case_id and when == "1.0"):
        name += f"_t{when}"
    return re.sub(r"[^A-Za-z0-9._+-]+", "-", name)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """The n road users present at a moment, on a grid of T steps; sizes are medians of the track.

    Attributes:
        track: (n,) index into the rows' labels.
        states: (n, T); at constant velocity before and after what is recorded.
        recorded: (n, T) True within the recorded piece of the track.
        interpolated: number of steps without a sample of their own.
    """

    track: IntArray
    length: FloatArray
    width: FloatArray
    states: States
    recorded: BoolArray
    interpolated: int


def sample_tracks(rows: TrackRows, moment_ms: float, grid_ms: FloatArray) -> Sampled:
    """Sample the road users of one case present at a moment, in the order of the rows.

    A sample within 0.6 ms of a step is taken unchanged; others follow a cubic through positions and
    velocities.
    """
    begin, end = rows.pieces
    stamps = rows.timestamp_ms
    present = (stamps[begin] <= moment_ms + STAMP_MS) & (stamps[end] >= moment_ms - STAMP_MS)
    first, last = begin[present][:, None], end[present][:, None]
    recorded = (grid_ms >= stamps[first] - STAMP_MS) & (grid_ms <= stamps[last] + STAMP_MS)
    motion, _, exact = interpolated(rows, first, last, np.broadcast_to(grid_ms, recorded.shape))
    speed = ahead_speed(motion["vx"], motion["vy"], motion["psi_rad"])
    states = States(x=motion["x"], y=motion["y"], heading=motion["psi_rad"], speed=speed)
    track = rows.track[begin[present]]
    spans = [slice(*np.searchsorted(rows.track, (number, number + 1))) for number in track]
    return Sampled(
        track=track,
        length=np.array([np.median(rows.length[span]) for span in spans], np.float64),
        width=np.array([np.median(rows.width[span]) for span in spans], np.float64),
        states=_extend(states, recorded, grid_ms / 1000.0),
        recorded=recorded,
        interpolated=int((recorded & ~exact).sum()),
    )


def interpolated(
    rows: TrackRows, first: IntArray, last: IntArray, time_ms: FloatArray
) -> tuple[dict[str, FloatArray], IntArray, BoolArray]:
    """Return pieces of tracks, from row ``first`` to ``last``, at times: a cubic between two samples.

    Returns the columns of the motion, the row of the nearest sample, and whether it is at the time.
    """
    stamps = rows.timestamp_ms
    right = np.clip(_search(rows, first, time_ms), first, last)
    left = np.maximum(right - 1, first)
    nearest = np.where(np.abs(stamps[left] - time_ms) < np.abs(stamps[right] - time_ms), left, right)
    outside = (time_ms <= stamps[first]) | (time_ms >= stamps[last])
    exact = np.abs(stamps[nearest] - time_ms) <= STAMP_MS
    alone = exact | outside
    i = np.where(alone, nearest, left)
    j = np.where(alone, nearest, right)
    span = np.where(i == j, 1.0, (stamps[j] - stamps[i]) / 1000.0)
    u = np.where(i == j, 0.0, (time_ms - stamps[i]) / 1000.0 / span)
    columns = {
        "x": _hermite(rows.x[i], rows.x[j], rows.vx[i] * span, rows.vx[j] * span, u),
        "y": _hermite(rows.y[i], rows.y[j], rows.vy[i] * span, rows.vy[j] * span, u),
        "vx": rows.vx[i] + u * (rows.vx[j] - rows.vx[i]),
        "vy": rows.vy[i] + u * (rows.vy[j] - rows.vy[i]),
        "psi_rad": wrap(rows.psi_rad[i] + u * wrap(rows.psi_rad[j] - rows.psi_rad[i])),
    }
    return columns, nearest, exact


def _search(rows: TrackRows, first: IntArray, time_ms: FloatArray) -> IntArray:
    if not len(rows):
        return np.zeros(np.broadcast_shapes(first.shape, time_ms.shape), np.int64)
    start = rows.timestamp_ms.min() - 1e6
    length = rows.timestamp_ms.max() + 1e6 - start
    axis = rows.timestamp_ms - start + length * rows.piece
    wanted = np.clip(time_ms - start, 0.0, length) + length * rows.piece[first]
    return np.asarray(np.searchsorted(axis, wanted), np.int64)


def _hermite(p: FloatArray, q: FloatArray, dp: FloatArray, dq: FloatArray, u: FloatArray) -> FloatArray:
    bend = dp * (1.0 - u) - dq * u + (q - p) * (2.0 * u - 1.0)
    return p + u * (q - p) + u * (1.0 - u) * bend


def _extend(states: States, recorded: BoolArray, time_s: FloatArray) -> States:
    """Continue states at constant velocity before and after the recorded steps, which are consecutive."""
    steps = np.arange(recorded.shape[1])
    first = np.argmax(recorded, axis=1)[:, None]
    last = recorded.shape[1] - 1 - np.argmax(recorded[:, ::-1], axis=1)[:, None]
    source = np.clip(steps, first, last)
    nearest = states[np.arange(len(recorded))[:, None], source]
    driven_m = (time_s - time_s[source]) * nearest.speed
    x, y = nearest.x + driven_m * np.cos(nearest.heading), nearest.y + driven_m * np.sin(nearest.heading)
    return replace(nearest, x=x, y=y)
