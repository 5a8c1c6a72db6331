"""Encounters of a dataset: two vehicles in consecutive moments, by the most critical one, in an order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.response.usual import USUAL, Population, counts, usual_columns
from scex_sumo.studies.moments.folder import MomentRef, as_row
from scex_sumo.studies.rank.exact import EVENTS, ExactScore
from scex_sumo.studies.rank.pairs import PAIRS
from scex_sumo.studies.rank.triage import BOTH, DATA_ERROR, judged

SEVERITY: Final = "severity"
STRESS: Final = ("stress_p_collision", "stress_p_critical")
TRIAGE: Final = ("verdict", "note")
_LINE: Final = ("recording", "case", "track_id", "person", "action", "doubt", "first_s", "last_s", "out")
_PLACE: Final = ("location", "recording", "case", "seed", "time_s")
_NEAR: Final = ("time_to_react", "gap_m", "time_s", "first_s", "last_s", "usual_rank", "response_s")
"""Columns whose small values come first in an order; so do those of texts."""
SAID: Final = "a data error, as the triage says"
_CONSECUTIVE = 1.5  # times between two moments of one encounter, over the time between two moments

_FIRST = (
    ("rank", pa.int64()),
    *((name, PAIRS.field(name).type) for name in ("track_id", "other_id", "kind")),
    *((name, pa.float64() if name == "time_s" else pa.string()) for name in _PLACE),
    *(("first_s", pa.float64()), ("last_s", pa.float64()), ("moments", pa.int64())),
)
ENCOUNTERS: Final = pa.schema(
    [
        *_FIRST,
        *(field for field in PAIRS if field.name not in [*dict(_FIRST), "doubt"]),
        *USUAL.items(),
        ("times_usual", pa.float64()),  # P over the median
        *((name, pa.float64()) for name in STRESS),
        ("more", pa.int64()),
        ("doubt", pa.string()),
        *((name, pa.string()) for name in TRIAGE),
    ]
)


def encounters_of(pairs: Sequence[tuple[MomentRef, pa.Table]], every_s: float) -> pa.Table:
    """Return the encounters of a data set, see `ENCOUNTERS`, without rank and what futures say.

    The same two vehicles in consecutive moments are one encounter: its row is that of the moment with the
    largest severity whose data are not doubtful.

    Args:
        pairs: moments, and their pairs as of `pairs_of_moment`.
        every_s: time between two moments.
    """
    rows = pa.concat_tables([PAIRS.empty_table(), *(table for _, table in pairs)]).combine_chunks()
    if not len(rows):
        return ENCOUNTERS.empty_table()
    refs = pa.Table.from_pylist([as_row(ref) for ref, _ in pairs]).select([*_PLACE])
    refs = refs.take(np.repeat(np.arange(len(pairs)), [len(table) for _, table in pairs]))
    order, begins = _grouped(rows, refs, _CONSECUTIVE * every_s)
    time, starts = np.asarray(refs["time_s"])[order], np.flatnonzero(begins)
    found = {name: rows[name] for name in PAIRS.names} | {name: refs[name] for name in _PLACE}
    best = order[_first_of_each(_worst_first(rows)[order], begins)]
    found = {name: column.take(best) for name, column in found.items()}
    found |= {
        "first_s": pa.array(np.minimum.reduceat(time, starts)),
        "last_s": pa.array(np.maximum.reduceat(time, starts)),
        "moments": pa.array(np.diff(starts, append=len(order))),
        "gap_m": pa.array(np.minimum.reduceat(np.asarray(rows["gap_m"])[order], starts)),
    }
    missing = pa.nulls(len(starts))
    columns = [found.get(field.name, missing).cast(field.type) for field in ENCOUNTERS]
    return _with_usual(pa.table(columns, schema=ENCOUNTERS))


def _grouped(rows: pa.Table, refs: pa.Table, apart_s: float) -> tuple[IntArray, BoolArray]:
    """Return an order (n,) that joins the rows of each encounter, and which one of the order begins one."""
    people = rows["person"].combine_chunks().dictionary_encode().indices
    who = pc.if_else(pc.is_valid(people), pc.subtract(-1, people), rows["track_id"])
    both = np.sort([np.asarray(ids).astype(np.int64) for ids in (who, rows["other_id"])], axis=0)
    record = pc.binary_join_element_wise(refs["recording"], refs["case"], "\n").combine_chunks()
    keys = np.stack([np.asarray(record.dictionary_encode().indices), *both])
    time = np.asarray(refs["time_s"])
    order = np.lexsort((time, *keys))
    differs = (np.diff(keys[:, order], axis=1) != 0).any(axis=0) | (np.diff(time[order]) > apart_s)
    return order, np.concatenate([[True], differs])


def _worst_first(rows: pa.Table) -> IntArray:
    """Return the place (n,) of each row: without doubt first, then by severity, then by P."""
    doubtful = np.asarray(pc.is_valid(rows["doubt"]))
    severity, probability = (-np.asarray(rows[name]) for name in (SEVERITY, "probability"))
    place = np.empty(len(rows), dtype=np.int64)
    place[np.lexsort((probability, severity, doubtful))] = np.arange(len(rows))
    return place


def _first_of_each(place: IntArray, begins: BoolArray) -> IntArray:
    """Return the index of the row of each group that has the least place."""
    group = np.cumsum(begins)
    order = np.lexsort((place, group))
    return np.asarray(order[np.flatnonzero(np.diff(group[order], prepend=0))])


def _with_usual(encounters: pa.Table) -> pa.Table:
    population = Population(encounters)
    rows = encounters.select(["location", "kind", "probability", "gap_m", "doubt"]).to_pylist()
    found = [
        population.usual(row["location"], row["kind"], row["probability"], counted=counts(row))
        for row in rows
    ]
    times = [
        row["probability"] / one.median if one and one.median else None
        for row, one in zip(rows, found, strict=True)
    ]
    return _set(encounters, usual_columns(found) | {"times_usual": times})


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
    return _set(table, {"rank": rank, "more": more})


def leads(encounters: pa.Table) -> pa.Table:
    """Return the first encounter of each line, see `ENCOUNTERS`."""
    return encounters.filter(pc.is_valid(encounters["more"]))


def _set(table: pa.Table, columns: Mapping[str, Sequence[Any]]) -> pa.Table:
    for name, values in columns.items():
        field = table.schema.field(name)
        table = table.set_column(table.schema.get_field_index(name), field, pa.array(values, field.type))
    return table


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
        if self.by not in ENCOUNTERS.names:
            raise UsageError(f"--by: got {self.by!r}; known: {', '.join(ENCOUNTERS.names)}")

    def check(self, first: int) -> None:
        """Raise a `UsageError` for an order by futures that only some moments have."""
        if self.by in STRESS and not first:
            raise UsageError(f"--by {self.by}: needs futures of every moment; add --first 32")

    def ranked(self, encounters: pa.Table) -> pa.Table:
        """Return encounters in this order, with ranks; equal ones by severity, then by P."""
        encounters = self._judged(encounters)
        column, keys = ENCOUNTERS.field(self.by), [(SEVERITY, "descending"), ("probability", "descending")]
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
        found = {name: [one[name] or None if one else None for one in verdicts] for name in TRIAGE}
        return _set(encounters, {"doubt": doubts, **found}) if self.triage else encounters

    def _is_out(self, encounters: pa.Table) -> pa.ChunkedArray:
        is_doubtful = pc.is_valid(encounters["doubt"])
        return pc.and_(is_doubtful, not self.keep_doubtful)


BY_SEVERITY: Final = Order()


@dataclass(frozen=True, kw_only=True)
class StressTest:
    """What the futures of a moment say about its pairs.

    Attributes:
        events: share of the futures in which two vehicles, by their ascending ids, collide and are critical.
    """

    events: Mapping[tuple[int, int], tuple[float, float]]

    @classmethod
    def of(cls, pairs: Sequence[IntArray], exact: ExactScore | None) -> StressTest:
        """Count critical encounters (E, 5) of futures; an exact probability counts where there is one."""
        sums: dict[tuple[int, int], FloatArray] = {}
        for one, other, hit, *_ in np.concatenate(pairs).tolist():
            key = (min(one, other), max(one, other))
            sums[key] = sums.get(key, np.zeros(2)) + np.array([hit, 1])
        shares = {key: (count / len(pairs)).tolist() for key, count in sums.items()}
        if exact is not None:
            shares |= {
                key: [
                    share if (p := exact.pair(*key, event)) is None else p
                    for share, event in zip(each, EVENTS, strict=True)
                ]
                for key, each in shares.items()
            }
        return cls(events={key: (each[0], each[1]) for key, each in shares.items()})


def with_stress(encounters: pa.Table, tests: Mapping[str, StressTest]) -> pa.Table:
    """Return encounters with what the futures of their moments, by name, say; null without any."""
    rows = encounters.select(["seed", "track_id", "other_id"]).to_pylist()
    found = []
    for row in rows:
        test = tests.get(row["seed"])
        key = min(row["track_id"], row["other_id"]), max(row["track_id"], row["other_id"])
        found.append((None, None) if test is None else test.events.get(key, (0.0, 0.0)))
    return _set(encounters, {name: [row[k] for row in found] for k, name in enumerate(STRESS)})
