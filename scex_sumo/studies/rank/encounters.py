"""Order of the encounters of a dataset, with what futures and a person say about them (triage)."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.errors import UsageError
from scex_sumo.results.tables.columns import schema
from scex_sumo.studies.moments.encounters import ENCOUNTERS, with_columns

TRIAGE: Final = ("verdict", "note")
_NEAR: Final = ("gap_m", "time_margin", "time_s", "first_s", "last_s", "conflict_s")
DATA_ERROR_DOUBT: Final = "a data error, as the triage says"
RANKED: Final = pa.schema(
    [
        *schema("rank"),
        *(field for field in ENCOUNTERS if field.name != "doubt"),
        *schema("stress_p_collision doubt", TRIAGE),
    ]
)
"""Columns of encounters in their order; of the stress test: the share of a moment's futures."""


def ranked(
    encounters: pa.Table, triage: Sequence[Mapping[str, str]] = (), by: str = "probability"
) -> pa.Table:
    """Return encounters with ranks, by a column and then by P; doubtful ones are last, without.

    Args:
        triage: verdicts as of `read_triage`; data errors are doubtful.
        by: column of `RANKED`; large values are first, but small ones of distances and times, and texts.
    """
    if by not in (known := [name for name in RANKED.names if not name.startswith("stress")]):
        raise UsageError(f"--by: got {by!r}; known: {', '.join(known)}")
    up = by in _NEAR or pa.types.is_string(RANKED.field(by).type)
    whole = pa.concat_tables([RANKED.empty_table(), encounters], promote_options="default").combine_chunks()
    table = _judged(whole, triage) if triage else whole
    table = table.append_column("out", pc.is_valid(table["doubt"]))
    order = [("out", "ascending"), (by, "ascending" if up else "descending"), ("probability", "descending")]
    table = table.sort_by([*order, ("seed", "ascending"), ("track_id", "ascending")])
    ranks = [None if out else number for number, out in enumerate(table["out"].to_pylist(), 1)]
    return with_columns(table.drop(["out"]), {"rank": ranks})


def with_stress(encounters: pa.Table, shares: Mapping[str, Mapping[tuple[int, int], float]]) -> pa.Table:
    """Return encounters with ``stress_p_collision``; null where the futures of a moment were not run.

    Shares are by moment, then by both track ids, ascending; pairs that never meet have none.
    """
    stress: list[float | None] = []
    for encounter in encounters.select(["seed", "track_id", "other_id"]).to_pylist():
        first, second = sorted((encounter["track_id"], encounter["other_id"]))
        of_moment = shares.get(encounter["seed"])
        stress.append(None if of_moment is None else of_moment.get((first, second), 0.0))
    return with_columns(encounters, {"stress_p_collision": stress})


_, _, DATA_ERROR = VERDICTS = ("test", "discard", "data error")
KEY: Final = ("recording", "case", "track_id", "other_id", "first_s", "last_s", "time_s")
"""Columns of the file besides verdict and note; as the page's script writes them."""
BOTH: Final = ("recording", "case", "track_id", "other_id")


def read_triage(path: Path) -> Sequence[Mapping[str, str]]:
    """Read the verdicts that the page has saved; raise a `UsageError` where a line is none."""
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
        try:
            float(row["time_s"])
        except ValueError:
            words = f"--triage {path}, line {number}: time {row['time_s']!r} is no number"
            raise UsageError(words) from None
    return rows


def _judged(encounters: pa.Table, triage: Sequence[Mapping[str, str]]) -> pa.Table:
    """Return encounters with the last verdict on their pair that was given for a time within each."""
    verdicts_of: dict[tuple[str, ...], list[Mapping[str, str]]] = {}
    for verdict in triage:
        verdicts_of.setdefault(_key(verdict), []).insert(0, verdict)
    doubts, verdicts = [], list[Mapping[str, str]]()
    for encounter in encounters.select(["doubt", "first_s", "last_s", *BOTH]).to_pylist():
        first_s, last_s, doubt = (encounter[name] for name in ("first_s", "last_s", "doubt"))
        of_pair = verdicts_of.get(_key(encounter), ())
        within = (verdict for verdict in of_pair if first_s <= float(verdict["time_s"]) <= last_s)
        verdicts.append(next(within, {}))
        doubts.append(DATA_ERROR_DOUBT if verdicts[-1].get("verdict") == DATA_ERROR else doubt)
    columns = {name: [verdict.get(name) or None for verdict in verdicts] for name in TRIAGE}
    return with_columns(encounters, {"doubt": doubts, **columns})


def _key(pair: Mapping[str, Any]) -> tuple[str, ...]:
    first, second = sorted((str(pair["track_id"]), str(pair["other_id"])))
    return str(pair["recording"]), str(pair["case"]), first, second
