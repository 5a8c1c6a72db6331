"""Reading CSV files of tracks: INTERACTION v1.0 and v1.2, TAF-BW."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.check import (
    BASE_COLUMNS,
    SHAPE_COLUMNS,
    check_header,
    explain_bad_values,
    explain_parse_error,
)
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, ROW_COLUMNS, TrackRows, TrackTable, segments_of
from scex_sumo.errors import TrackError

__all__ = ["MOTOR_TYPES", "OBSTACLE_SIZES", "TrackRows", "TrackTable", "read_tracks", "segments_of"]

MOTOR_TYPES = frozenset(
    ("car", "truck", "bus", "van", "motorcycle", "motorbike", "trailer", "taxi", "vehicle", "truck_bus")
)
"""Types that become vehicles of a seed scene; every other type is an obstacle."""

OBSTACLE_SIZES = {"pedestrian": (0.6, 0.6), "bicycle": (1.8, 0.7), "tram": (30.0, 2.6)}
"""Length and width in m where the recording gives none; other types are as large as a bicycle, also
``pedestrian/bicycle``, which may be either."""


def read_tracks(path: str | Path) -> TrackTable:
    """Read a recording in INTERACTION format; nothing is repaired.

    Rows may come in any order, unknown columns are ignored. Pedestrians and cyclists of INTERACTION v1.0 are
    read from ``pedestrian_tracks_*.csv`` beside ``vehicle_tracks_*.csv``.

    Raises:
        TrackError: file missing or no CSV, column missing, value missing or not a number, no rows.
    """
    path = Path(path)
    parts = [_read_columns(path)]
    beside = path.with_name(path.name.replace("vehicle_tracks", "pedestrian_tracks"))
    if beside != path and beside.is_file():
        parts.append(_read_columns(beside))
    columns, cases, labels, types = _merge(parts)
    motor = np.array([name in MOTOR_TYPES for name in types], bool)
    of_track = _majority_type(columns["track"], columns["agent_type"], len(labels))
    is_vehicle = motor[of_track[columns["track"]]]
    vehicles = _rows(columns, is_vehicle, cases, labels, types, of_track)
    others = _rows(columns, ~is_vehicle, cases, labels, types, of_track)
    for k, label in enumerate(vehicles.labels):
        if not re.fullmatch(r"-?\d+(\.0*)?", label):
            raise TrackError(
                f"{path}: track_id {label!r} of a {vehicles.types[k]} is not an integer; number the vehicles"
            )
    return TrackTable(
        path=path,
        cases=tuple(sorted(cases, key=_sort_key)),
        vehicles=vehicles,
        others=others,
        step_s=_usual_step(vehicles if len(vehicles) else others),
    )


def _usual_step(rows: TrackRows) -> float:
    within = np.diff(rows.segment) == 0
    steps = np.diff(rows.timestamp_ms)[within]
    steps = steps[steps > 0]
    if not len(steps):
        return 0.1
    # 30 Hz in whole milliseconds is 33, 33, 34: the mean of the steps without the gaps
    return float(np.mean(steps[np.abs(steps / np.median(steps) - 1.0) < 0.2])) / 1000.0


def _sort_key(label: str) -> tuple[bool, float, str]:
    """Numbers in numerical order, before names."""
    try:
        return False, float(label), label
    except ValueError:
        return True, 0.0, label


def _read_columns(path: Path) -> dict[str, Any]:
    """Columns of one file; ``case_id``, ``track_id`` and ``agent_type`` as (codes, names)."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    header = check_header(path)
    numbers = [name for name in (*BASE_COLUMNS, *SHAPE_COLUMNS, "frame_id") if name in header]
    words = [name for name in ("case_id", "track_id", "agent_type") if name in header]
    numbers = [name for name in numbers if name not in words]
    types = {name: pa.float64() for name in numbers} | dict.fromkeys(words, pa.string())
    try:
        arrow = csv.read_csv(
            path,
            read_options=csv.ReadOptions(column_names=header, skip_rows=1),
            convert_options=csv.ConvertOptions(include_columns=[*numbers, *words], column_types=types),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        raise explain_parse_error(path, header, numbers, str(error)) from None
    if arrow.num_rows == 0:
        raise TrackError(f"{path}: a header and no rows; give a file with tracks")
    columns: dict[str, Any] = {name: np.array(arrow[name].to_numpy(), np.float64) for name in numbers}
    for name in words:
        text = pc.utf8_trim_whitespace(arrow[name])
        if name == "agent_type":
            text = pc.utf8_lower(text)
        encoded = text.combine_chunks().dictionary_encode()
        columns[name] = encoded.indices.to_numpy().astype(np.int64), [str(n) for n in encoded.dictionary]
    _check_values(path, header, columns)
    return columns


def _check_values(path: Path, header: list[str], columns: dict[str, Any]) -> None:
    codes, names = columns["agent_type"]
    motor = np.array([name in MOTOR_TYPES for name in names], bool)[codes]
    bad = np.zeros(len(codes), bool)
    for name in ("timestamp_ms", "x", "y", "vx", "vy"):
        bad |= ~np.isfinite(columns[name])
    for name in SHAPE_COLUMNS:
        if name not in columns:
            columns[name] = np.full(len(codes), np.nan)
        bad |= motor & ~np.isfinite(columns[name])
    for name in ("length", "width"):
        bad |= motor & ~(columns[name] > 0.0)
    for name in ("track_id", "agent_type", "case_id"):
        if name in columns and "" in columns[name][1]:
            bad |= columns[name][0] == columns[name][1].index("")
    if bad.any():
        raise explain_bad_values(path, header, int(np.argmax(bad)), MOTOR_TYPES)
    if "frame_id" not in columns or not np.isfinite(columns["frame_id"]).all():
        columns["frame_id"] = np.rint(columns["timestamp_ms"] / 100.0)


def _merge(parts: list[dict[str, Any]]) -> tuple[dict[str, Any], list[str], list[str], list[str]]:
    """One set of columns of several files; a track is a pair of case and id, apart for each file."""
    cases: dict[str, int] = {}
    types: dict[str, int] = {}
    labels: list[str] = []
    merged: list[dict[str, Any]] = []
    for part in parts:
        size = len(part["x"])
        case = _renumbered(part.get("case_id", (np.zeros(size, np.int64), [""])), cases)
        kind = _renumbered(part["agent_type"], types)
        ids, names = part["track_id"]
        pair, track = np.unique(case * len(names) + ids, return_inverse=True)
        merged.append(
            {name: part[name] for name in ROW_COLUMNS if name not in ("case", "segment")}
            | {"case": case, "track": track + len(labels), "agent_type": kind}
        )
        labels += [names[i] for i in pair % len(names)]
    columns = {name: np.concatenate([part[name] for part in merged]) for name in merged[0]}
    return columns, list(cases), labels, list(types)


def _renumbered(column: tuple[IntArray, list[str]], known: dict[str, int]) -> IntArray:
    """(N,) numbers of the values; new names are added to the known ones."""
    codes, names = column
    return np.array([known.setdefault(name, len(known)) for name in names], np.int64)[codes]


def _majority_type(track: IntArray, kind: IntArray, tracks: int) -> IntArray:
    """(K,) most frequent type of each track: trackers change their mind now and then."""
    kinds = int(kind.max()) + 1
    counts = np.bincount(track * kinds + kind, minlength=tracks * kinds).reshape(tracks, kinds)
    return np.asarray(np.argmax(counts, axis=1), np.int64)


def _rows(
    columns: dict[str, Any],
    keep: BoolArray,
    cases: list[str],
    labels: list[str],
    types: list[str],
    type_of_track: IntArray,
) -> TrackRows:
    """Sorted rows of vehicles or of others; the order of the file leaves no trace."""
    case = np.array(_ranks(cases), np.int64)[columns["case"][keep]]
    track = columns["track"][keep]
    stamps = columns["timestamp_ms"][keep]
    frames = columns["frame_id"][keep]
    label_rank = np.array(_ranks(labels), np.int64)[track]
    order = np.lexsort((frames, stamps, track, label_rank, case))
    track, case = track[order], case[order]
    first = np.ones(len(track), bool)
    first[1:] = np.diff(track) != 0
    number = np.asarray(np.cumsum(first) - 1, np.int64)
    flat = {name: columns[name][keep][order] for name in FLOAT_COLUMNS}
    kinds = [types[type_of_track[k]] for k in track[first]]
    _fill_shapes(flat, number, kinds)
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
    """(n,) position of each label in numerical order; equal labels share one."""
    place = {label: i for i, label in enumerate(sorted(set(labels), key=_sort_key))}
    return [place[label] for label in labels]


def _fill_shapes(flat: dict[str, FloatArray], track: IntArray, kinds: list[str]) -> None:
    """Sizes and headings that the format leaves out for pedestrians and cyclists, in place."""
    sizes = np.array([_obstacle_size(kind) for kind in kinds]).reshape(-1, 2)[track]
    for name, default in (("length", sizes[:, 0]), ("width", sizes[:, 1])):
        flat[name] = np.where(flat[name] > 0.0, flat[name], default)
    course = np.arctan2(flat["vy"], flat["vx"])
    flat["psi_rad"] = np.where(np.isfinite(flat["psi_rad"]), flat["psi_rad"], course)


def _obstacle_size(kind: str) -> tuple[float, float]:
    return OBSTACLE_SIZES.get(kind, OBSTACLE_SIZES["bicycle"])
