"""Cases of INTERACTION v1.2: which one becomes a seed scene."""

from __future__ import annotations

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.datasets.moment import CASE_FRAME, busiest, find_moments
from scex_sumo.converters.tracks.rows import TrackTable


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
        if _as_number(name) == _as_number(str(case)):
            return index
    examples = ", ".join(table.cases[:3]) + (", ..." if len(table.cases) > 3 else "")
    raise TrackError(f"{table.path}: no case {case}; it has {len(table.cases)} cases: {examples}")


def _as_number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
