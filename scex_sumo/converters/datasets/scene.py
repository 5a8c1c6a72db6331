"""Seed scene of one moment of a recording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.cleaning.plausibility import doubts, lost_vehicles
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.datasets.interaction import marked_vehicles
from scex_sumo.converters.datasets.moment import CASE_FRAME, STAMP_MS, busiest, find_moments
from scex_sumo.converters.datasets.sample import Sampled, sample_tracks
from scex_sumo.converters.naming import number, unique_names
from scex_sumo.converters.tracks.check import MISSING
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, number_of, other_rate
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Obstacles, SeedScene

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
    min_history: int = 0,
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
        why = f"only {kinds}" if kinds else "none left after repairs"
        raise TrackError(f"{table.path}: no motor vehicle among the tracks ({why}); give others")
    case_id, warnings = "", tuple[str, ...]()
    if table.has_cases:
        index = choose_case(table, case, time_s)
        case_id = table.cases[index]
        table = table.case(index)
        if repair:
            raw = table
            table, more = repair_tracks(raw)
            findings, warnings = (*findings, *more), doubts([lost_vehicles(raw, table)])
    elif case is not None:
        raise TrackError(
            f"{table.path}: no case_id column, so no case {case}; choose the moment with --time S"
        )
    moment_ms = _choose_moment(table, case_id, time_s)
    scene = _build(table, name, location, case_id, moment_ms, min_history, findings)
    return replace(scene, notes=(*scene.notes, *warnings))


def _choose_moment(table: TrackTable, case_id: str, time_s: float | None) -> float:
    """Stamp of the moment, ms: the nearest frame to a time, else the busiest moment."""
    rows = table.vehicles
    where = f"{table.path}: case {case_id}" if case_id else f"{table.path}"
    if not len(rows):
        raise TrackError(f"{where}: no vehicle (left after repairs); choose another moment")
    if time_s is None:
        if not table.has_cases:
            return 1000.0 * busiest(find_moments(table)).time_s
        here = rows.timestamp_ms[rows.frame_id == CASE_FRAME]
        if not len(here):
            raise TrackError(f"{where}: no vehicle in frame {CASE_FRAME}; choose the moment with --time S")
        return float(here[0])
    stamps = np.concatenate((rows.stamps_ms, table.others.stamps_ms))
    half_ms = 500.0 * table.step_s + STAMP_MS
    begin, end = stamps.min(), stamps.max()
    if not np.isfinite(time_s) or not begin - half_ms <= 1000.0 * time_s <= end + half_ms:
        raise TrackError(
            f"{where}: no moment at {time_s:g} s, the recording spans {begin / 1000:.1f} to "
            f"{end / 1000:.1f} s; choose --time in between"
        )
    wanted, at = 1000.0 * time_s, np.array([1000.0 * time_s])
    nearest = float(rows.stamps_ms[np.argmin(np.abs(rows.stamps_ms - wanted))])
    if abs(nearest - wanted) > 1000.0 * STEP_S and not len(sample_tracks(rows, wanted, at).track):
        raise TrackError(
            f"{where}: no vehicle at {time_s:g} s; the nearest moment with one is {nearest / 1000:.1f} s"
        )
    return nearest if abs(nearest - wanted) <= half_ms else wanted


def _build(
    table: TrackTable,
    name: str,
    location: str,
    case_id: str,
    moment_ms: float,
    min_history: int,
    findings: tuple[str, ...],
) -> SeedScene:
    steps_ms = 1000.0 * STEP_S * np.arange(-HISTORY_STEPS, FUTURE_STEPS + 1)
    grid_ms: FloatArray = (moment_ms + steps_ms).astype(np.float64)
    rows = table.vehicles
    cars = sample_tracks(rows, moment_ms, grid_ms)
    steps = cars.recorded[:, :HISTORY_STEPS].sum(axis=1).astype(np.int64)
    keep = steps >= min_history
    if not keep.any():
        raise TrackError(
            f"{table.path}: none of {len(keep)} vehicles at {moment_ms / 1000:g} s has {min_history} "
            "recorded previous steps; choose a later moment or a smaller min_history"
        )
    notes = _notes(table, cars, steps[keep], moment_ms, findings)
    if not keep.all():
        notes.append(f"{int((~keep).sum())} vehicles with less than {min_history} previous steps left out")
    valid = cars.recorded[keep, HISTORY_STEPS + 1 :]
    states = cars.states[keep]
    ids = [number_of(rows.labels[k]) for k in cars.track[keep]]
    source = {"kind": "tracks", "tracks": str(table.path.absolute()), "time_s": moment_ms / 1000.0}
    if case_id:
        source |= {"case": case_id, **marked_vehicles(table.path, case_id)}
    return SeedScene(
        name=_moment_name(name, case_id, moment_ms),
        location=location,
        time_s=moment_ms / 1000.0,
        track_ids=np.array(ids, np.int64),
        types=tuple(_plain_word(rows.types[k].lower()) for k in cars.track[keep]),
        length=cars.length[keep],
        width=cars.width[keep],
        history=states[:, : HISTORY_STEPS + 1],
        recorded_steps=steps[keep],
        future=states[:, HISTORY_STEPS + 1 :] if valid.any() else None,
        future_valid=valid if valid.any() else None,
        obstacles=_obstacles(table.others, moment_ms, grid_ms, vehicles=ids),
        notes=tuple(notes),
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
    table: TrackTable, cars: Sampled, steps: IntArray, moment_ms: float, findings: tuple[str, ...]
) -> list[str]:
    notes = []
    if findings:
        notes.append(f"{table.path.name} repaired: {'; '.join(findings)}")
    if other_rate(step_s := table.recorded_step_s or table.step_s):
        notes.append(f"recorded at {1 / step_s:.3g} Hz: interpolated to 10 Hz")
    elif cars.interpolated:
        notes.append(f"{cars.interpolated} missing samples interpolated")
    earliest = float(table.vehicles.stamps_ms[0])
    there = min(HISTORY_STEPS, int((moment_ms - earliest + STAMP_MS) // (1000.0 * STEP_S)))
    if there < HISTORY_STEPS:
        notes.append(f"{there} of {HISTORY_STEPS} previous steps recorded, constant velocity before")
    short = int((steps < there).sum())
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


def choose_case(table: TrackTable, case: str | float | None, time_s: float | None) -> int:
    """Index of the case by its id; else the first one if a time is given; else the busiest one."""
    if case is None:
        if time_s is not None:
            return int(table.vehicles.case.min())
        candidates = find_moments(table)
        if not candidates:
            raise TrackError(
                f"{table.path}: no case has a vehicle in frame {CASE_FRAME}; choose with --case ID --time S"
            )
        return table.cases.index(busiest(candidates).case)
    if str(case) in table.cases:
        return table.cases.index(str(case))
    for index, name in enumerate(table.cases):
        if number(name) == number(str(case)):
            return index
    examples = ", ".join(table.cases[:3]) + (", ..." if len(table.cases) > 3 else "")
    raise TrackError(f"{table.path}: no case {case}; it has {len(table.cases)} cases: {examples}")
