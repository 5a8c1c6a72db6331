"""Explanation of what is wrong with a track file that cannot be read, in one line."""

from __future__ import annotations

import csv
import gzip
import math
import zlib
from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from pathlib import Path
from textwrap import shorten

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.naming import open_binary, open_text, other_content
from scex_sumo.converters.tracks.check import (
    BASE_COLUMNS,
    MAX_VALUES,
    MISSING,
    SHAPE_COLUMNS,
    column_names,
    first_line,
    repeated,
)

_NEEDED = f"INTERACTION tracks need {', '.join((*BASE_COLUMNS, *SHAPE_COLUMNS))}"


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
                problem = f"{name} is {_short(value)}, not a number"
                return TrackError(f"{path}: line {line}: {problem}; repair or drop it")
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
