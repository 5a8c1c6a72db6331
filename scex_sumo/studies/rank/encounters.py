"""Order of the encounters of a dataset, with what futures and a person say about them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.errors import UsageError
from scex_sumo.studies.moments.encounters import ENCOUNTERS, SEVERITY, with_columns
from scex_sumo.studies.rank.triage import BOTH, DATA_ERROR, judged

STRESS: Final = ("stress_p_collision", "stress_p_critical")
"""Shares of the futures in which a pair of a moment on the page collides, and is critical."""
TRIAGE: Final = ("verdict", "note")
_LINE: Final = ("recording", "case", "track_id", "person", "action", "doubt", "first_s", "last_s", "out")
_NEAR: Final = ("time_to_react", "gap_m", "time_s", "first_s", "last_s", "usual_rank", "response_s")
"""Columns whose small values come first in an order; so do those of texts."""
SAID: Final = "a data error, as the triage says"
RANKED: Final = pa.schema(
    [
        ("rank", pa.int64()),
        *(field for field in ENCOUNTERS if field.name != "doubt"),
        *((name, pa.float64()) for name in STRESS),
        ("more", pa.int64()),
        ("doubt", pa.string()),
        *((name, pa.string()) for name in TRIAGE),
    ]
)
"""Columns of encounters in an order."""


def _whole(encounters: pa.Table) -> pa.Table:
    """Return the columns of `RANKED`, null where there are none."""
    return pa.concat_tables([RANKED.empty_table(), encounters], promote_options="default").combine_chunks()


def _joined(table: pa.Table) -> pa.Table:
    """Return sorted encounters with ``rank`` and ``more``.

    What one vehicle does to several others at a time is one line: they have one rank and stand together, and
    the first has their number besides it as ``more``, which is null for the others.
    """
    lines: list[list[int]] = []
    known: dict[tuple[Any, ...], list[tuple[float, float, int]]] = {}
    out = table["out"].to_pylist()
    for k, row in enumerate(table.select(_LINE).to_pylist()):
        acts = row["recording"], row["case"], row["person"] or row["track_id"], row["action"]
        begun = known.setdefault((*acts, row["doubt"] is None, row["out"]), [])
        first, last = row["first_s"], row["last_s"]
        line = next((line for one, other, line in begun if one <= last and first <= other), len(lines))
        if line == len(lines):
            lines.append([])
            begun.append((first, last, line))
        lines[line].append(k)
    rank = [None if out[k] else number for number, line in enumerate(lines, 1) for k in line]
    more = [len(line) - 1 if k == line[0] else None for line in lines for k in line]
    table = table.take(np.array([k for line in lines for k in line], dtype=np.int64))
    return with_columns(table, {"rank": rank, "more": more})


def leads(encounters: pa.Table) -> pa.Table:
    """Return the first encounter of each line, see `RANKED`."""
    return encounters.filter(pc.is_valid(encounters["more"]))


@dataclass(frozen=True, kw_only=True)
class Order:
    """Order of encounters.

    Attributes:
        by: column; large values are first, but small ones of distances, times and places.
        keep_doubtful: rank encounters whose data are doubtful, too; else they are last and have no rank.
        triage: verdicts as of `read_triage`; data errors are doubtful.
    """

    by: str = SEVERITY
    keep_doubtful: bool = False
    triage: Sequence[Mapping[str, str]] = ()

    def __post_init__(self) -> None:
        known = [name for name in RANKED.names if name not in STRESS]  # which only some have
        if self.by not in known:
            raise UsageError(f"--by: got {self.by!r}; known: {', '.join(known)}")

    def ranked(self, encounters: pa.Table) -> pa.Table:
        """Return encounters in this order, with ranks; equal ones by severity, then by P."""
        encounters = self._judged(_whole(encounters))
        column, keys = RANKED.field(self.by), [(SEVERITY, "descending"), ("probability", "descending")]
        up = self.by in _NEAR or pa.types.is_string(column.type)
        table = encounters.append_column("out", self._is_out(encounters))
        order = [("out", "ascending"), (self.by, "ascending" if up else "descending"), *keys]
        table = table.sort_by([*order, ("seed", "ascending"), ("track_id", "ascending")])
        return _joined(table).drop(["out"])

    def _judged(self, encounters: pa.Table) -> pa.Table:
        rows = encounters.select(["doubt", "first_s", "last_s", *BOTH]).to_pylist()
        verdicts = judged(rows, self.triage)
        doubts = [
            SAID if verdict and verdict["verdict"] == DATA_ERROR else row["doubt"]
            for row, verdict in zip(rows, verdicts, strict=True)
        ]
        columns = {name: [one[name] or None if one else None for one in verdicts] for name in TRIAGE}
        return with_columns(encounters, {"doubt": doubts, **columns}) if self.triage else encounters

    def _is_out(self, encounters: pa.Table) -> pa.ChunkedArray:
        is_doubtful = pc.is_valid(encounters["doubt"])
        return pc.and_(is_doubtful, not self.keep_doubtful)


BY_SEVERITY: Final = Order()


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
