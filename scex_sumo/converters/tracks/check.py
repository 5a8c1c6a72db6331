"""Errors of a track file: what is wrong with it, in one line."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

from scex_sumo.errors import TrackError

BASE_COLUMNS = ("track_id", "timestamp_ms", "agent_type", "x", "y", "vx", "vy")
SHAPE_COLUMNS = ("psi_rad", "length", "width")
_NEEDED = f"INTERACTION tracks need {', '.join((*BASE_COLUMNS, *SHAPE_COLUMNS))}"


def check_header(path: Path) -> list[str]:
    """Column names of a track file.

    Raises:
        TrackError: file missing, empty, not CSV, separated by something else, or without a needed column.
    """
    if path.is_dir():
        raise TrackError(f"{path}: a folder; give one CSV file of it, e.g. vehicle_tracks_000.csv")
    try:
        with path.open("rb") as file:
            first = file.readline(65536)
    except FileNotFoundError:
        raise TrackError(f"{path}: no such file; check the path of the tracks") from None
    except OSError as error:
        raise TrackError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None
    if not first.strip():
        raise TrackError(f"{path}: empty; give a CSV file with tracks")
    try:
        line = first.decode("utf-8-sig").strip()
    except UnicodeDecodeError:
        raise TrackError(f"{path}: not CSV (binary data); {_NEEDED}") from None
    if line.startswith("<") or "\0" in line:
        kind = "XML, perhaps the map" if line.startswith("<") else "binary data"
        raise TrackError(f"{path}: not CSV ({kind}); {_NEEDED}")
    return _check_names(path, line)


def _check_names(path: Path, line: str) -> list[str]:
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in line and "," not in line:
            raise TrackError(f"{path}: columns are separated by {name}; save it with commas")
    header = [name.strip().strip('"') for name in line.split(",")]
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise TrackError(f"{path}: column {', '.join(twice)} is there twice; keep one")
    shapes = () if path.name.startswith("pedestrian_tracks") else SHAPE_COLUMNS
    missing = [name for name in (*BASE_COLUMNS, *shapes) if name not in header]
    if missing:
        found = ", ".join(header[:14]) + (", ..." if len(header) > 14 else "")
        if len(found) > 160:
            found = found[:157] + "..."
        raise TrackError(f"{path}: no column {', '.join(missing)} (found: {found}); {_NEEDED}")
    return header


def explain_parse_error(path: Path, header: Sequence[str], numbers: Sequence[str], reason: str) -> TrackError:
    """The first row with too few or too many values, or a value that is no number."""
    for line, row in _lines(path):
        if len(row) != len(header):
            got = f"{len(row)} values" if len(row) != 1 else "1 value"
            return TrackError(f"{path}: line {line} has {got} for {len(header)} columns; repair or drop it")
        for name in numbers:
            value = row[header.index(name)]
            if not _is_number(value):
                return TrackError(
                    f"{path}: line {line}: {name} is {value!r}, not a number; repair or drop it"
                )
    return TrackError(f"{path}: not CSV ({reason.splitlines()[0]}); {_NEEDED}")


def explain_bad_values(path: Path, header: Sequence[str], index: int, motor: Collection[str]) -> TrackError:
    """What is missing or impossible in the data row of an index (0 is the first after the header)."""
    for count, (line, row) in enumerate(_lines(path)):
        if count < index:
            continue
        values = dict(zip(header, (value.strip() for value in row), strict=False))
        for name in ("track_id", "agent_type", "case_id"):
            if name in header and not values[name]:
                return TrackError(f"{path}: line {line}: {name} is missing; repair or drop the row")
        kind = values["agent_type"].lower()
        names = (*BASE_COLUMNS, *SHAPE_COLUMNS) if kind in motor else BASE_COLUMNS
        for name in names:
            if name in ("track_id", "agent_type"):
                continue
            value = values[name]
            if not _is_number(value) or not value or not math.isfinite(float(value)):
                got = repr(value) if value else "missing"
                return TrackError(f"{path}: line {line}: {name} of a {kind} is {got}; repair or drop the row")
            if name in ("length", "width") and float(value) <= 0.0:
                return TrackError(f"{path}: line {line}: {name} is {value} m, must be positive")
    return TrackError(f"{path}: data row {index + 1} has a missing value; repair or drop the row")


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Data rows with their line numbers, blank lines left out as the fast reader does."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        reader = csv.reader(file)
        next(reader)
        for row in reader:
            if row:
                yield reader.line_num, row


def _is_number(value: str) -> bool:
    text = value.strip()
    if not text:
        return True  # an empty value reads as missing
    try:
        float(text)
    except ValueError:
        return text.lower() in ("null", "na", "n/a", "#n/a")
    return "_" not in text
