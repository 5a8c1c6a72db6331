"""Reader of track files in INTERACTION format."""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, numbers_in
from scex_sumo.base.errors import TrackError, listed
from scex_sumo.converters.naming import in_arrow, open_binary
from scex_sumo.converters.tracks.check import (
    BASE_COLUMNS,
    MAX_VALUES,
    MISSING,
    SHAPE_COLUMNS,
    column_names,
    first_line,
    repeated,
)
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES, OTHER_TYPES, fill_sizes
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, TrackRows, TrackTable, number_of, segments_of

WALKERS = ("vehicle_tracks", "pedestrian_tracks")
"""Beginnings of the names of a file of vehicles and the one of pedestrians and cyclists beside it."""

MAX_MISSING = 0.1
"""A larger share of rows without a value means another format, and is an error."""
MAX_FRAME = 1e12
MIN_STEP_S, MAX_STEP_S = 0.001, 0.5
"""Limits of the time between two samples of a track; they decide between milliseconds and seconds."""


def read_tracks(
    path: str | Path, *, walkers: tuple[str, str] = WALKERS, vehicles: Collection[str] | None = None
) -> TrackTable:
    """Read a recording in INTERACTION format, plain or packed; nothing is repaired.

    Rows may have any order. Unknown columns and single rows without a value are left out.

    Args:
        walkers: part of the file's name, and that of the file beside it with pedestrians and cyclists.
        vehicles: ids of the tracks that are vehicles; None tells them by their types.
    """
    path = Path(path)
    files = [path]
    beside = path.parent / path.name.replace(*walkers)
    if beside != path and beside.is_file():
        files.append(beside)
    return tracks_of(
        path, [read_columns(file, shapes=not file.name.startswith(walkers[1])) for file in files], vehicles
    )


def tracks_of(
    path: Path,
    read: Sequence[tuple[dict[str, Any], list[str]]],
    vehicles: Collection[str] | None = None,
    *,
    by_text: bool = False,
) -> TrackTable:
    """Return the tracks of parts of a recording, as of `read_columns`; ``vehicles`` as of `read_tracks`.

    ``by_text``: tracks are in the order of their ids as texts, not as numbers.
    """
    columns, cases, labels, types = _merge([table for table, _ in read])
    counts = np.zeros((len(labels), len(types)), np.int64)
    np.add.at(counts, (columns["track"], columns["agent_type"]), 1)
    of_track: IntArray = np.argmax(counts, axis=1)
    unknown: tuple[str, ...] = ()
    if vehicles is not None:
        motor = np.array([label in vehicles for label in labels], bool)
    else:
        if not set(types) <= MOTOR_TYPES | OTHER_TYPES:
            from scex_sumo.converters.tracks.unknown import with_unknown_vehicles

            sizes, speed = (columns["length"], columns["width"]), np.hypot(columns["vx"], columns["vy"])
            of_track, unknown = with_unknown_vehicles(types, of_track, columns["track"], *sizes, speed)
        motor = np.array([name in MOTOR_TYPES for name in types], bool)[of_track]
    renumbered = _number(path, columns, labels, [types[k] for k in of_track], motor)
    is_vehicle = motor[columns["track"]]
    rows, others = (
        _rows(columns, keep, cases, labels, types, of_track, by_text) for keep in (is_vehicle, ~is_vehicle)
    )
    return TrackTable(
        path=path,
        cases=tuple(sorted(cases, key=_sort_key)),
        vehicles=rows,
        others=others,
        step_s=_usual_step(rows if len(rows) else others),
        notes=(*(phrase for _, notes in read for phrase in notes), *unknown, *renumbered),
    )


def _number(
    path: Path, columns: dict[str, Any], labels: list[str], types: list[str], motor: BoolArray
) -> list[str]:
    numbered = [int(k) for k in np.flatnonzero(motor)]
    for k in numbered:
        if not re.fullmatch(r"-?\d+(\.0*)?", labels[k]):
            raise TrackError(
                f"{path}: track_id {labels[k][:24]!r} of a {types[k][:24]} is not an integer; number the "
                "vehicles"
            )
        if not -(2**63) < number_of(labels[k]) < 2**63:
            raise TrackError(f"{path}: track_id {labels[k][:24]}... is beyond 64 bits; number the vehicles")
    _, first = np.unique(columns["track"], return_index=True)
    used: set[tuple[int, int]] = set()
    free = max((number_of(labels[k]) for k in numbered), default=0)
    renamed = []
    # The shortest spelling keeps its number.
    for k in sorted(numbered, key=lambda i: (len(labels[i]), labels[i])):
        case = int(columns["case"][first[k]])
        if (case, number_of(labels[k])) in used:
            free = free + 1 if free < 2**63 - 1 else min(n for _, n in used) - 1
            renamed.append(f"{labels[k]} is {free}")
            labels[k] = str(free)
        used.add((case, number_of(labels[k])))
    return [f"different track ids that are the same number, renumbered: {listed(renamed)}"] if renamed else []


def _usual_step(rows: TrackRows) -> float:
    # Of whole tracks, not of segments: tracks from Parquet may have samples further apart than a gap.
    steps = np.diff(rows.timestamp_ms)[np.diff(rows.track) == 0]
    steps = steps[steps > 0]
    if not len(steps):
        return 0.1
    # The lower median is itself a step, so that at least one is near it.
    usual = np.quantile(steps, 0.5, method="lower")
    # 30 Hz in whole milliseconds is 33, 33, 34: the mean of the steps without the gaps
    return float(np.mean(steps[np.abs(steps / usual - 1.0) < 0.2])) / 1000.0


def _sort_key(label: str) -> tuple[bool, float, str]:
    try:
        return False, float(label), label
    except ValueError:
        return True, 0.0, label


def _merge(tables: list[dict[str, Any]]) -> tuple[dict[str, Any], list[str], list[str], list[str]]:
    cases: dict[str, int] = {}
    types: dict[str, int] = {}
    labels: list[str] = []
    merged: list[dict[str, Any]] = []
    for table in tables:
        size = len(table["x"])
        case = _renumbered(table.get("case_id", (np.zeros(size, np.int64), [""])), cases)
        kind = _renumbered(table["agent_type"], types)
        ids, names = table["track_id"]
        pair, track = np.unique(case * len(names) + ids, return_inverse=True)
        merged.append(
            {name: table[name] for name in ("frame_id", *FLOAT_COLUMNS)}
            | {"case": case, "track": track + len(labels), "agent_type": kind}
        )
        labels += [names[i] for i in pair % len(names)]
    columns = {name: np.concatenate([table[name] for table in merged]) for name in merged[0]}
    return columns, list(cases), labels, list(types)


def _renumbered(column: tuple[IntArray, list[str]], known: dict[str, int]) -> IntArray:
    codes, names = column
    return np.array([known.setdefault(name, len(known)) for name in names], np.int64)[codes]


def _rows(
    columns: dict[str, Any],
    keep: BoolArray,
    cases: list[str],
    labels: list[str],
    types: list[str],
    type_of_track: IntArray,
    by_text: bool,
) -> TrackRows:
    case = np.array(_ranks(cases), np.int64)[columns["case"][keep]]
    track = columns["track"][keep]
    stamps = columns["timestamp_ms"][keep]
    frames = columns["frame_id"][keep]
    label_rank = np.unique(labels, return_inverse=True)[1] if by_text else np.array(_ranks(labels), np.int64)
    order = np.lexsort((frames, stamps, track, label_rank[track], case))
    track, case = track[order], case[order]
    first = np.ones(len(track), bool)
    first[1:] = np.diff(track) != 0
    number = np.asarray(np.cumsum(first) - 1, np.int64)
    flat = {name: columns[name][keep][order] for name in FLOAT_COLUMNS}
    kinds = [types[type_of_track[k]] for k in track[first]]
    fill_sizes(flat, number, kinds)
    course = np.arctan2(flat["vy"], flat["vx"])
    flat["psi_rad"] = np.where(np.isfinite(flat["psi_rad"]), flat["psi_rad"], course)
    return TrackRows(
        case=case.astype(np.int64),
        track=number,
        segment=segments_of(number, flat["timestamp_ms"]),
        labels=tuple(labels[k] for k in track[first]),
        types=tuple(kinds),
        frame_id=np.rint(frames[order]).astype(np.int64),
        **flat,
    )


def _ranks(labels: list[str]) -> list[int]:
    place = {label: i for i, label in enumerate(sorted(set(labels), key=_sort_key))}
    return [place[label] for label in labels]


def read_columns(path: Path, *, shapes: bool = True) -> tuple[dict[str, Any], list[str]]:
    """Read the columns of one file; ``case_id``, ``track_id`` and ``agent_type`` as (codes, names).

    ``shapes``: whether headings and sizes are needed. Also a phrase each about rows left out and units.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    header, before = _header(path, shapes=shapes)
    numbers = [name for name in (*BASE_COLUMNS, *SHAPE_COLUMNS, "frame_id") if name in header]
    words = [name for name in ("case_id", "track_id", "agent_type") if name in header]
    numbers = [name for name in numbers if name not in words]
    types = {name: pa.float64() for name in numbers} | dict.fromkeys(words, pa.string())
    distinct = [name if header.index(name) == k else f"{name} {k}" for k, name in enumerate(header)]
    try:
        with open_binary(path) as file:
            arrow = csv.read_csv(
                in_arrow(file),
                read_options=csv.ReadOptions(column_names=distinct, skip_rows=before + 1),
                convert_options=csv.ConvertOptions(
                    include_columns=[*numbers, *words], column_types=types, null_values=list(MISSING)
                ),
            )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        from scex_sumo.converters.tracks.explain import explain_parse_error

        raise explain_parse_error(path, header, numbers, str(error)) from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise TrackError(f"{path}: cannot be unpacked ({error}); fetch the file again") from None
    if arrow.num_rows == 0:
        raise TrackError(f"{path}: a header and no rows; give a file with tracks")
    columns: dict[str, Any] = {name: numbers_in(arrow[name]) for name in numbers}
    for name in words:
        text = pc.utf8_trim_whitespace(arrow[name])
        if name == "agent_type":
            text = pc.utf8_lower(text)
        encoded = text.combine_chunks().dictionary_encode()
        columns[name] = np.asarray(encoded.indices, dtype=np.int64), [str(n) for n in encoded.dictionary]
    columns, notes = _checked(path, header, columns)
    notes += _in_milliseconds(path, columns)
    if count := int(((columns["length"] <= 0.0) | (columns["width"] <= 0.0)).sum()):
        notes.append(f"{count} rows of a length or width that is not positive: the usual one")
    return columns, notes


def _header(path: Path, *, shapes: bool = True) -> tuple[list[str], int]:
    """Column names of a track file, and the blank lines before; ``shapes``: whether these are needed."""
    needed, before = (*BASE_COLUMNS, *(SHAPE_COLUMNS if shapes else ())), 0
    try:
        with open_binary(path) as file:
            before, first = first_line(file)
            line = first.decode("utf-8-sig").rstrip("\r\n")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError):
        line = ""
    header = column_names(line)
    if "\r" in line or repeated(header) or not set(needed) <= set(header):
        from scex_sumo.converters.tracks.explain import explain_header

        raise explain_header(path, needed)
    return header, before


def _checked(path: Path, header: list[str], columns: dict[str, Any]) -> tuple[dict[str, Any], list[str]]:
    codes, names = columns["agent_type"]
    motor = np.array([name in MOTOR_TYPES for name in names], bool)[codes]
    wrong, missing = np.zeros((2, len(codes)), bool)
    lacking = {}
    for name in ("timestamp_ms", "x", "y", "vx", "vy", *SHAPE_COLUMNS):
        values: FloatArray = columns.setdefault(name, np.full(len(codes), np.nan))
        needed = motor if name in SHAPE_COLUMNS else np.ones(len(codes), bool)
        wrong |= needed & (np.abs(values) > MAX_VALUES.get(name, 1e4))
        if name in ("length", "width"):
            wrong |= motor & (values <= 0.0)
        empty: BoolArray = needed & np.isnan(values)
        if empty.any():
            lacking[name] = empty
            missing |= empty
    for name in ("track_id", "agent_type", "case_id"):
        for word in MISSING:
            if name in columns and word in columns[name][1]:
                wrong |= columns[name][0] == columns[name][1].index(word)
    if missing.mean() > MAX_MISSING:
        wrong |= missing
    if wrong.any():
        from scex_sumo.converters.tracks.explain import explain_bad_values

        raise explain_bad_values(path, header, int(np.argmax(wrong)), MOTOR_TYPES)
    # A comparison with nan is False, too.
    if "frame_id" not in columns or not (np.abs(columns["frame_id"]) <= MAX_FRAME).all():
        columns["frame_id"] = np.rint(columns["timestamp_ms"] / 100.0)
    if not missing.any():
        return columns, []
    first = int(np.argmax(missing)) + 1
    note = f"{int(missing.sum())} rows without {' or '.join(lacking)} left out (first: data row {first})"
    kept = {
        name: (column[0][~missing], column[1]) if isinstance(column, tuple) else column[~missing]
        for name, column in columns.items()
    }
    return kept, [note]


def _in_milliseconds(path: Path, columns: dict[str, Any]) -> list[str]:
    """Convert stamps in seconds to milliseconds, in place; returns a phrase if it does."""
    track = columns["track_id"][0]
    if "case_id" in columns:
        track = track * len(columns["case_id"][1]) + columns["case_id"][0]
    order = np.lexsort((columns["timestamp_ms"], track))
    steps = np.diff(columns["timestamp_ms"][order])[np.diff(track[order]) == 0]
    steps = steps[steps > 0.0]
    usual = float(np.median(steps)) if len(steps) else 100.0
    if 1000.0 * MIN_STEP_S <= usual <= 1000.0 * MAX_STEP_S + 1.5:
        return []
    if MIN_STEP_S <= usual <= MAX_STEP_S + 0.0015:
        columns["timestamp_ms"] = np.round(1000.0 * columns["timestamp_ms"], 6)
        columns["frame_id"] = np.rint(columns["timestamp_ms"] / 100.0)
        return ["timestamp_ms is in seconds: converted to milliseconds"]
    raise TrackError(
        f"{path}: samples of a track are {usual / 1000.0:g} s apart by timestamp_ms, {MIN_STEP_S:g} to "
        f"{MAX_STEP_S:g} s expected; give the stamps in milliseconds"
    )
