"""Checks of a track file: its columns, and the size of its values."""

from __future__ import annotations

from codecs import BOM_UTF8
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, TrackRows, TrackTable

BASE_COLUMNS = ("track_id", "timestamp_ms", "agent_type", "x", "y", "vx", "vy")
SHAPE_COLUMNS = ("psi_rad", "length", "width")
KNOWN = (*BASE_COLUMNS, *SHAPE_COLUMNS, "frame_id", "case_id")
HEADINGS = ("yaw_rad", "heading_rad")
"""Other names of ``psi_rad``, by preference: SinD has both, and its ``heading_rad`` is the course."""
MISSING = ("", "NA", "N/A", "#N/A", "NULL", "null", "None", "NaN", "nan", "n/a")
"""Words for a missing value."""

MAX_VALUES = {"timestamp_ms": 1e16, "x": 1e8, "y": 1e8, "vx": 1e4, "vy": 1e4, "psi_rad": 1e4}
"""Largest magnitude of a value; 1e4 for sizes."""

MAX_HOURS = 24.0
"""A longer recording has a stamp of another clock, and its length costs memory."""


def check_values(table: TrackTable) -> None:
    """Raise a `TrackError` for tracks with impossible values or a span of days."""
    for rows in (table.vehicles, table.others):
        columns = {name: getattr(rows, name) for name in FLOAT_COLUMNS}
        # Repairs leave out vehicles of an impossible size, but not of none.
        largest = {**MAX_VALUES, "length": np.inf, "width": np.inf}
        refuse_values(table.path, columns, largest, partial(_track_of, rows))
        if len(rows) and float(np.ptp(rows.timestamp_ms)) > 3.6e6 * MAX_HOURS:
            ends = [rows.labels[rows.track[find(rows.timestamp_ms)]] for find in (np.argmin, np.argmax)]
            problem = f"{np.ptp(rows.timestamp_ms) / 3.6e6:.3g} hours from track {ends[0]} to {ends[1]}"
            raise TrackError(f"{table.path}: {problem}, at most {MAX_HOURS:g} are read; repair the stamps")


def _track_of(rows: TrackRows, row: int) -> str:
    return f"track {rows.labels[rows.track[row]]}"


def refuse_values(
    path: Path,
    columns: Mapping[str, FloatArray | IntArray],
    largest: Mapping[str, float],
    where: Callable[[int], str],
    *,
    optional: Collection[str] = (),
) -> None:
    """Raise a `TrackError` for the first value of a column that is missing (nan) or too large.

    Args:
        columns: (N,) each.
        largest: magnitudes by column; 1e4 for others.
        where: what has the value in a row, for the message.
        optional: columns with missing values.
    """
    for name, values in columns.items():
        limit = largest.get(name, 1e4)
        wrong = ~(np.abs(values) <= limit)
        if name in optional:
            wrong &= ~np.isnan(values)
        if wrong.any():
            row = int(np.argmax(wrong))
            problem = "missing" if np.isnan(values[row]) else f"{values[row]:g}, beyond {limit:g}"
            raise TrackError(f"{path}: {name} of {where(row)} is {problem}; repair the row, or leave it out")


def first_line(file: BinaryIO) -> tuple[int, bytes]:
    """Return how many blank lines a file begins with, and the line after them; empty without any."""
    lines = enumerate(iter(partial(file.readline, 65536), b""))
    return next(((k, line) for k, line in lines if line.removeprefix(BOM_UTF8).strip()), (0, b""))


def column_names(line: str) -> list[str]:
    """Names in the first line of a track file; ours in lower case, a heading as ``psi_rad``."""
    header = [name.strip().strip("\"'").strip() for name in line.strip().split(",")]
    header = [name.lower() if name.lower() in (*KNOWN, *HEADINGS) else name for name in header]
    heading = next((name for name in HEADINGS if name in header), "")
    if "psi_rad" not in header and heading:
        header[header.index(heading)] = "psi_rad"
    return header


def repeated(header: Sequence[str]) -> list[str]:
    """Our names that are in a header more than once."""
    return [name for name in KNOWN if header.count(name) > 1]
