"""Checks of a track file: its columns, the size of its values, and what is wrong in one line."""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from codecs import BOM_UTF8
from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from textwrap import shorten
from typing import BinaryIO

import numpy as np

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.naming import open_binary, open_text, other_content
from scex_sumo.converters.tracks.rows import TrackTable

BASE_COLUMNS = ("track_id", "timestamp_ms", "agent_type", "x", "y", "vx", "vy")
SHAPE_COLUMNS = ("psi_rad", "length", "width")
KNOWN = (*BASE_COLUMNS, *SHAPE_COLUMNS, "frame_id", "case_id")
HEADINGS = ("yaw_rad", "heading_rad")
"""Other names of ``psi_rad``, by preference: SinD has both, and its ``heading_rad`` is the course."""
MISSING = ("", "NA", "N/A", "#N/A", "NULL", "null", "None", "NaN", "nan", "n/a")
"""Words for a missing value."""

_NEEDED = f"INTERACTION tracks need {', '.join((*BASE_COLUMNS, *SHAPE_COLUMNS))}"

MAX_VALUES = {"timestamp_ms": 1e16, "x": 1e8, "y": 1e8, "vx": 1e4, "vy": 1e4, "psi_rad": 1e4}
"""Largest magnitude of a value; 1e4 for sizes."""

MAX_HOURS = 24.0
"""A longer recording has a stamp of another clock, and its length costs memory."""


def check_values(table: TrackTable) -> None:
    """Raise a `TrackError` for tracks with impossible values or a span of days."""
    for rows in (table.vehicles, table.others):
        # Repairs leave out vehicles of an impossible size, but not of none.
        for name, largest in {**MAX_VALUES, "length": np.inf, "width": np.inf}.items():
            wrong = ~(np.abs(getattr(rows, name)) <= largest)
            if wrong.any():
                row = int(np.argmax(wrong))
                said = f"{getattr(rows, name)[row]:g}"
                said += f", beyond {largest:g}" if largest < np.inf else ", no number"
                raise TrackError(f"{table.path}: {name} of track {rows.labels[rows.track[row]]} is {said}")
        if len(rows) and float(np.ptp(rows.timestamp_ms)) > 3.6e6 * MAX_HOURS:
            ends = [rows.labels[rows.track[find(rows.timestamp_ms)]] for find in (np.argmin, np.argmax)]
            said = f"{np.ptp(rows.timestamp_ms) / 3.6e6:.3g} hours from track {ends[0]} to {ends[1]}"
            raise TrackError(f"{table.path}: {said}, at most {MAX_HOURS:g} are read; repair the stamps")


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


def explain_header(path: Path, needed: Sequence[str]) -> TrackError:
    """Error about a file without a header that has all ``needed`` columns."""
    if path.is_dir():
        return TrackError(f"{path}: a folder; give one CSV file of it, e.g. vehicle_tracks_000.csv")
    try:
        with open_binary(path) as file:
            _, first = first_line(file)
    except FileNotFoundError:
        return TrackError(f"{path}: no such file; check the path of the tracks")
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        return TrackError(f"{path}: cannot be unpacked ({error}); fetch the file again")
    except OSError as error:
        return TrackError(f"{path}: cannot be read ({error.strerror}); check its permissions")
    if kind := other_content(path):
        return TrackError(f"{path}: {kind}, not CSV; {_NEEDED}")
    if b"\r" in first.rstrip(b"\r\n"):
        return TrackError(f"{path}: its lines end with CR alone; save it with LF or CRLF")
    if not first.strip():
        return TrackError(f"{path}: empty; give a CSV file with tracks")
    line = first.decode("utf-8-sig", errors="replace").strip()
    if line.startswith("<"):
        return TrackError(f"{path}: not CSV (XML, perhaps the map); {_NEEDED}")
    if "\0" in line or "\ufffd" in line:
        return TrackError(f"{path}: not CSV (binary data); {_NEEDED}")
    return _explain_names(path, line, needed)


def _explain_names(path: Path, line: str, needed: Sequence[str]) -> TrackError:
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if line.count(mark) > line.count(","):
            return TrackError(f"{path}: columns are separated by {name}; save it with commas")
    header = column_names(line)
    if twice := repeated(header):
        return TrackError(f"{path}: column {', '.join(twice)} is there twice; keep one")
    missing = [name for name in needed if name not in header]
    shown = shorten(", ".join(header), 160, placeholder=" ...")
    return TrackError(f"{path}: no column {', '.join(missing)} (found: {shown}); {_NEEDED}")


def explain_parse_error(path: Path, header: Sequence[str], numbers: Sequence[str], reason: str) -> TrackError:
    """Error about the first row with too few or too many values, or a value that is not a number."""
    for line, row in _lines(path):
        if len(row) != len(header):
            got = f"{len(row)} values" if len(row) != 1 else "1 value"
            return TrackError(f"{path}: line {line} has {got} for {len(header)} columns; repair or drop it")
        for name, value in ((name, row[header.index(name)]) for name in numbers):
            if not _is_number(value):
                said = f"{name} is {_short(value)}, not a number"
                return TrackError(f"{path}: line {line}: {said}; repair or drop it")
    return TrackError(f"{path}: not CSV ({reason.splitlines()[0][:120]}); {_NEEDED}")


def explain_bad_values(path: Path, header: Sequence[str], index: int, motor: Collection[str]) -> TrackError:
    """Error about the missing or impossible value of a data row; index 0 is the first after the header."""
    line, row = next(islice(_lines(path), index, None), (0, []))
    values = dict(zip(header, (value.strip() for value in row), strict=False))
    kind = values.get("agent_type", "").lower()
    words = [name for name in ("track_id", "agent_type", "case_id") if name in header]
    numbers = (*BASE_COLUMNS, *(SHAPE_COLUMNS if kind in motor else ()))
    for name in (*words, *(name for name in numbers if name not in words)) if row else ():
        if wrong := _wrong(name, values.get(name, ""), is_word=name in words):
            whose = name if name in (*words, "length", "width") else f"{name} of a {kind[:24]}"
            return TrackError(f"{path}: line {line}: {whose} is {wrong}; repair or drop the row")
    return TrackError(f"{path}: data row {index + 1} has a missing value; repair or drop the row")


def _wrong(name: str, value: str, *, is_word: bool) -> str:
    if value in MISSING:
        return f"missing ({value})" if value else "missing"
    if is_word:
        return ""
    if not _is_number(value) or not math.isfinite(float(value)):
        return _short(value)
    if name in ("length", "width") and float(value) <= 0.0:
        return f"{value} m, must be positive"
    largest = MAX_VALUES.get(name, 1e4)
    return f"{_short(value)}, beyond {largest:g}" if abs(float(value)) > largest else ""


def _short(value: str) -> str:
    return repr(value if len(value) <= 24 else f"{value[:24]}...")


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    with open_text(path, errors="replace") as file:
        reader = csv.reader(file)
        try:
            next(filter(None, reader))
            for row in reader:
                if row:
                    yield reader.line_num, row
        except csv.Error:  # a value longer than 128 KiB: the fast reader's reason is the message then
            return


def _is_number(value: str) -> bool:
    text = value.strip()
    if text in MISSING:
        return True
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
