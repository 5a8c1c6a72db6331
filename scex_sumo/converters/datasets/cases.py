"""Cases of a file in INTERACTION v1.2 format: which one is taken, and which of its vehicles are marked."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.moment import CASE_FRAME, busiest, find_moments
from scex_sumo.converters.naming import in_arrow, number, open_binary, open_text
from scex_sumo.converters.tracks.rows import TrackTable

MARKS = {"to_predict": "track_to_predict", "interesting": "interesting_agent"}
"""Marks of vehicles in the files of the INTERPRET challenge, and their columns."""


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
    if not table.has_cases:
        raise TrackError(
            f"{table.path}: no case_id column, so no case {case}; choose the moment with --time S"
        )
    examples = ", ".join(table.cases[:3]) + (", ..." if len(table.cases) > 3 else "")
    raise TrackError(f"{table.path}: no case {case}; it has {len(table.cases)} cases: {examples}")


def marked_vehicles(tracks: Path, case: str) -> dict[str, list[str]]:
    """Return the marked vehicles of a case by `MARKS`; nothing if the file has no marks."""
    if not {*MARKS.values(), "case_id", "track_id"} <= set(_header(tracks)):
        return {}
    rows = _marks(tracks, tracks.stat().st_mtime_ns)
    return {name: sorted({track for of, track in rows[name] if of == case}) for name in MARKS}


def _header(tracks: Path) -> list[str]:
    with open_text(tracks, errors="replace") as file:
        return file.readline(65536).strip().split(",")


@lru_cache(maxsize=1)
def _marks(tracks: Path, _changed_ns: int) -> dict[str, set[tuple[str, str]]]:
    """Return case and track id of all rows with each mark; `TrackError` if a mark is no number."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    words, marks = ("case_id", "track_id"), tuple(MARKS.values())
    types = dict.fromkeys(words, pa.string()) | dict.fromkeys(marks, pa.float64())
    options = csv.ConvertOptions(include_columns=[*types], column_types=types)
    try:
        with open_binary(tracks) as file:
            table = csv.read_csv(in_arrow(file), convert_options=options)
    except pa.ArrowInvalid as error:
        from scex_sumo.converters.tracks.explain import explain_parse_error

        raise explain_parse_error(tracks, _header(tracks), marks, str(error)) from None
    table = table.set_column(0, "case_id", pc.utf8_trim_whitespace(table["case_id"]))
    marked = {name: table.filter(pc.equal(table[column], 1.0)).to_pylist() for name, column in MARKS.items()}
    return {
        name: {(row["case_id"], row["track_id"].partition(".")[0]) for row in rows}
        for name, rows in marked.items()
    }
