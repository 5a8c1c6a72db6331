"""Triage of encounters: verdicts and notes of a person, saved by the page as CSV, and read again."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.errors import UsageError

TEST, DISCARD, DATA_ERROR = VERDICTS = ("test", "discard", "data error")
KEY: Final = ("recording", "case", "track_id", "other_id", "first_s", "last_s", "time_s")
"""Columns of the file besides verdict and note; as the page's script writes them."""
BOTH: Final = ("recording", "case", "track_id", "other_id")


def read_triage(path: Path) -> Sequence[Mapping[str, str]]:
    """Read the verdicts of a file that the page has saved.

    Raises:
        UsageError: it cannot be read, lacks a column, or has an unknown verdict.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"--triage {path}: cannot be read: {error}") from None
    for number, row in enumerate(rows, 2):
        missing = [name for name in (*BOTH, "time_s", "verdict", "note") if row.get(name) is None]
        if missing:
            raise UsageError(f"--triage {path}, line {number}: no {missing[0]}; save it again on the page")
        if row["verdict"] not in ("", *VERDICTS):
            known = ", ".join(VERDICTS)
            raise UsageError(f"--triage {path}, line {number}: verdict {row['verdict']!r}; known: {known}")
        if not _is_number(row["time_s"]):
            raise UsageError(f"--triage {path}, line {number}: time {row['time_s']!r} is no number")
    return rows


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def judged(
    rows: Sequence[Mapping[str, Any]], triage: Sequence[Mapping[str, str]]
) -> list[Mapping[str, str] | None]:
    """Return the verdict of each encounter: the last one of its pair that was given for a time within it."""
    given: dict[tuple[str, ...], list[Mapping[str, str]]] = {}
    for row in triage:
        given.setdefault(_key(row), []).append(row)
    return [
        next(
            (
                one
                for one in reversed(given.get(_key(row), []))
                if row["first_s"] <= float(one["time_s"]) <= row["last_s"]
            ),
            None,
        )
        for row in rows
    ]


def _key(row: Mapping[str, Any]) -> tuple[str, ...]:
    one, other = sorted((str(row["track_id"]), str(row["other_id"])))
    return str(row["recording"]), str(row["case"]), one, other
