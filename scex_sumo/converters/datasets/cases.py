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
    examples = ", ".join(table.cases[:3]) + (", ..." if len(table.cases) > 3 else "")
    raise TrackError(f"{table.path}: no case {case}; it has {len(table.cases)} cases: {examples}")


def marked_vehicles(tracks: Path, case: str) -> dict[str, list[str]]:
    """Return the marked vehicles of a case by `MARKS`; nothing if the file has no marks."""
    with open_text(tracks, errors="replace") as file:
        header = file.readline(65536).strip().split(",")
    if not {*MARKS.values(), "case_id", "track_id"} <= set(header):
        return {}
    rows = _marks(tracks, tracks.stat().st_mtime_ns)
    return {name: sorted({track for of, track in rows[name] if of == float(case)}) for name in MARKS}


@lru_cache(maxsize=1)
def _marks(tracks: Path, _changed_ns: int) -> dict[str, set[tuple[float, str]]]:
    """Return case and track id of all rows with each mark."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    types = {"case_id": pa.float64(), "track_id": pa.string(), **dict.fromkeys(MARKS.values(), pa.float64())}
    with open_binary(tracks) as file:
        options = csv.ConvertOptions(include_columns=[*types], column_types=types)
        table = csv.read_csv(in_arrow(file), convert_options=options)
    marked = {name: table.filter(pc.equal(table[column], 1.0)).to_pylist() for name, column in MARKS.items()}
    return {
        name: {(row["case_id"], row["track_id"].partition(".")[0]) for row in rows}
        for name, rows in marked.items()
    }
