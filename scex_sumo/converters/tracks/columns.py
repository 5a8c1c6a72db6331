"""Columns of a track file, read and checked."""

from __future__ import annotations

import gzip
import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.naming import open_binary
from scex_sumo.converters.tracks.check import (
    BASE_COLUMNS,
    MAX_VALUES,
    MISSING,
    SHAPE_COLUMNS,
    check_header,
    explain_bad_values,
    explain_parse_error,
)
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES

MAX_MISSING = 0.1
"""A larger share of rows without a value means another format, and is an error."""
MAX_FRAME = 1e12
DRIVEN_MPS, MIN_ALIGNED = 3.0, 0.9
"""From this speed on the cosine between heading and motion is at least 0.9."""
MIN_STEP_S, MAX_STEP_S = 0.001, 0.5
"""Limits of the time between two samples of a track; they decide between milliseconds and seconds."""


def read_columns(path: Path, *, shapes: bool = True) -> tuple[dict[str, Any], list[str]]:
    """Read the columns of one file; ``case_id``, ``track_id`` and ``agent_type`` as (codes, names).

    ``shapes``: whether headings and sizes are needed.

    Returns:
        The columns, and a phrase each about rows left out and converted units.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    header = check_header(path, shapes=shapes)
    numbers = [name for name in (*BASE_COLUMNS, *SHAPE_COLUMNS, "frame_id") if name in header]
    words = [name for name in ("case_id", "track_id", "agent_type") if name in header]
    numbers = [name for name in numbers if name not in words]
    types = {name: pa.float64() for name in numbers} | dict.fromkeys(words, pa.string())
    column_names = _distinct(header)
    try:
        with open_binary(path) as file:
            arrow = csv.read_csv(
                file,
                read_options=csv.ReadOptions(column_names=column_names, skip_rows=1),
                convert_options=csv.ConvertOptions(
                    include_columns=[*numbers, *words], column_types=types, null_values=list(MISSING)
                ),
            )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        raise explain_parse_error(path, header, numbers, str(error)) from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise TrackError(f"{path}: cannot be unpacked ({error}); fetch the file again") from None
    if arrow.num_rows == 0:
        raise TrackError(f"{path}: a header and no rows; give a file with tracks")
    columns: dict[str, Any] = {name: np.array(arrow[name].to_numpy(), np.float64) for name in numbers}
    for name in words:
        text = pc.utf8_trim_whitespace(arrow[name])
        if name == "agent_type":
            text = pc.utf8_lower(text)
        encoded = text.combine_chunks().dictionary_encode()
        columns[name] = encoded.indices.to_numpy().astype(np.int64), [str(n) for n in encoded.dictionary]
    columns, notes = _checked(path, header, columns)
    return columns, [*notes, *_in_milliseconds(path, columns), *_in_radians(columns)]


def _distinct(header: list[str]) -> list[str]:
    return [name if header.index(name) == k else f"{name} {k}" for k, name in enumerate(header)]


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
        raise explain_bad_values(path, header, int(np.argmax(wrong)), MOTOR_TYPES)
    # A comparison with nan is False, too.
    if "frame_id" not in columns or not (np.abs(columns["frame_id"]) <= MAX_FRAME).all():
        columns["frame_id"] = np.rint(columns["timestamp_ms"] / 100.0)
    if not missing.any():
        return columns, []
    first = int(np.argmax(missing)) + 1
    said = f"{int(missing.sum())} rows without {' or '.join(lacking)} left out (first: data row {first})"
    kept = {
        name: (column[0][~missing], column[1]) if isinstance(column, tuple) else column[~missing]
        for name, column in columns.items()
    }
    return kept, [said]


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


def _in_radians(columns: dict[str, Any]) -> list[str]:
    heading, (vx, vy) = columns["psi_rad"], (columns["vx"], columns["vy"])
    driven = (np.hypot(vx, vy) > DRIVEN_MPS) & np.isfinite(heading)
    if not driven.any() or np.abs(heading[driven]).max() < 2.0 * math.pi:
        return []
    course = np.arctan2(vy[driven], vx[driven])
    fits = [float(np.median(np.cos(scale * heading[driven] - course))) for scale in (1.0, math.pi / 180.0)]
    if fits[1] < MIN_ALIGNED or fits[0] > fits[1]:
        return []
    columns["psi_rad"] = np.radians(heading)
    return ["psi_rad is in degrees: converted to radians"]
