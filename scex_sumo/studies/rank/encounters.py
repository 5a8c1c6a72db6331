"""Order of the encounters of a dataset, with what futures and a person say about them (triage)."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.errors import UsageError
from scex_sumo.results.tables.columns import schema
from scex_sumo.studies.moments.encounters import ENCOUNTERS, with_columns

STRESS: Final = ("stress_p_collision", "stress_p_critical")
"""Shares of the futures in which a pair of a moment on the page collides, and is critical."""
TRIAGE: Final = ("verdict", "note")
PROBABILITY: Final = "probability"
_NEAR: Final = ("gap_m", "time_margin", "time_s", "first_s", "last_s", "conflict_s")
"""Columns whose small values come first in an order; so do those of texts."""
SAID: Final = "a data error, as the triage says"
RANKED: Final = pa.schema(
    [
        *schema("rank"),
        *(field for field in ENCOUNTERS if field.name != "doubt"),
        *schema(STRESS, "doubt", TRIAGE),
    ]
)
"""Columns of encounters in an order."""


def _whole(encounters: pa.Table) -> pa.Table:
    """Return the columns of `RANKED`, null where there are none."""
    return pa.concat_tables([RANKED.empty_table(), encounters], promote_options="default").combine_chunks()


@dataclass(frozen=True, kw_only=True)
class Order:
    """Order of encounters.

    Attributes:
        by: column; large values are first, but small ones of distances, times and places.
        triage: verdicts as of `read_triage`; data errors are doubtful.
    """

    by: str = PROBABILITY
    triage: Sequence[Mapping[str, str]] = ()

    def __post_init__(self) -> None:
        known = [name for name in RANKED.names if name not in STRESS]  # which only some have
        if self.by not in known:
            raise UsageError(f"--by: got {self.by!r}; known: {', '.join(known)}")

    def ranked(self, encounters: pa.Table) -> pa.Table:
        """Return encounters in this order, with ranks; equal ones by P. Doubtful ones are last, without."""
        encounters = self._judged(_whole(encounters))
        up = self.by in _NEAR or pa.types.is_string(RANKED.field(self.by).type)
        table = encounters.append_column("out", pc.is_valid(encounters["doubt"]))
        order = [
            ("out", "ascending"),
            (self.by, "ascending" if up else "descending"),
            (PROBABILITY, "descending"),
        ]
        table = table.sort_by([*order, ("seed", "ascending"), ("track_id", "ascending")])
        ranks = [None if out else number for number, out in enumerate(table["out"].to_pylist(), 1)]
        return with_columns(table.drop(["out"]), {"rank": ranks})

    def _judged(self, encounters: pa.Table) -> pa.Table:
        rows = encounters.select(["doubt", "first_s", "last_s", *BOTH]).to_pylist()
        verdicts = judged(rows, self.triage)
        doubts = [
            SAID if verdict and verdict["verdict"] == DATA_ERROR else row["doubt"]
            for row, verdict in zip(rows, verdicts, strict=True)
        ]
        columns = {name: [one[name] or None if one else None for one in verdicts] for name in TRIAGE}
        return with_columns(encounters, {"doubt": doubts, **columns}) if self.triage else encounters


BY_PROBABILITY: Final = Order()


def with_stress(
    encounters: pa.Table, shares: Mapping[str, Mapping[tuple[int, int], tuple[float, float]]]
) -> pa.Table:
    """Return encounters with `STRESS`; null where the futures of a moment were not run.

    Args:
        shares: by moment, then by the two track ids, ascending; pairs that never meet have none.
    """
    stress: list[tuple[float | None, float | None]] = []
    for row in encounters.select(["seed", "track_id", "other_id"]).to_pylist():
        pair = min(row["track_id"], row["other_id"]), max(row["track_id"], row["other_id"])
        known = shares.get(row["seed"])
        stress.append((None, None) if known is None else known.get(pair, (0.0, 0.0)))
    return with_columns(encounters, {name: [row[k] for row in stress] for k, name in enumerate(STRESS)})


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
