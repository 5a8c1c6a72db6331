"""Tables of a ranking: its moments, and the columns of its encounters."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from scex_sumo.base.errors import TrackError
from scex_sumo.base.files import replacing
from scex_sumo.certainty.response.answer import any_of, once_in
from scex_sumo.certainty.response.usual import AT_SITE, usual_of
from scex_sumo.page.study import Column, Row
from scex_sumo.studies.moments.folder import as_row
from scex_sumo.studies.rank.ranking_run import RankingRun

MOMENTS: Final = pa.schema(
    [
        *((name, pa.string()) for name in ("seed", "location", "recording", "case")),
        *((name, pa.float64()) for name in ("time_s", "human_p_collision", "human_severity")),
        ("vehicles", pa.int64()),
        ("failure", pa.string()),
    ]
)
"""Columns of ``moments.parquet``."""


def moments_table(run: RankingRun) -> pa.Table:
    """Return the moments of a ranking by their human-like severity, largest first; then those that failed."""
    failed = [*run.unreadable.values(), *(failure for _, failure in sorted(run.failures.items()))]
    if not run.pairs:
        reason = f"; the first of {len(failed)} failures: {failed[0].reason}" if failed else ""
        raise TrackError(
            f"none of {len(run.recordings)} recordings has a moment with {run.settings.min_vehicles} moving "
            f"vehicles that could be run{reason}; lower --every or --min-vehicles, or look at the recordings"
        )
    rows = [as_row(ref) | _human_like(pairs) for ref, pairs in run.pairs]
    rows.sort(key=lambda row: (-row["human_severity"], row["seed"]))
    rows += [as_row(failure) | {"failure": failure.reason} for failure in failed]
    return pa.Table.from_pylist(rows, schema=MOMENTS)


def _human_like(pairs: pa.Table) -> dict[str, float]:
    """Return P of any collision and the expected severe injuries of pairs whose data are not doubtful."""
    sure = pairs.filter(pc.is_null(pairs["doubt"]))
    value, severity = any_of(sure["probability"].to_pylist()), pc.sum(sure["severity"]).as_py() or 0.0
    return {"human_p_collision": value, "human_severity": severity}


def page_columns() -> list[Column]:
    """Return the columns of encounters on the page."""
    return [
        Column("rank", "place"),
        Column(pair_words, "pair", "words", "Who responds → who acts"),
        Column("kind", "kind", "words"),
        Column("location", "site", "words"),
        Column("recording", "recording", "words"),
        Column("time_s", "time", "seconds", "In the recording, of its most critical moment"),
        Column("probability", "people collide", "often", "Human-like P of a collision"),
        Column("takes", "what it takes", "words"),
        Column("needed_braking", "needed braking", "tenths", "Of the responder, m/s²"),
        Column("time_to_react", "time to react", "seconds", "Left to the responder"),
        Column("severity", "severe injuries", "often", "Expected, human-like"),
        Column("times_usual", "× usual", "tenths", "P over the median of the class"),
        Column("stress_p_collision", "stress test", "percent", "P(collision) with the drawn models"),
        Column("doubt", "doubt", "words"),
        Column("verdict", "verdict", "words"),
    ]


def printed_columns() -> list[Column]:
    """Return the columns of encounters in the terminal."""
    return [
        Column("rank", "rank"),
        Column(pair_words, "pair", "words"),
        Column("kind", "kind", "words"),
        Column(lambda row: f"{row['recording']} {row['case']}".rstrip(), "recording", "words"),
        Column("time_s", "time", "seconds"),
        Column(lambda row: once_in(row["probability"]), "people collide", "words"),
        Column("takes", "what it takes", "words"),
        Column(_braking, "braking", "text"),
        Column(lambda row: once_in(row["severity"]), "severe injury", "words"),
        Column(_times_usual, "usual", "words"),
        Column(stress_words, "stress", "text"),
    ]


def stress_words(row: Row) -> str | None:
    """Return the share of the stress test in which a pair collides; None where no futures were run."""
    share = row["stress_p_collision"]
    return None if share is None else f"{share:.0%}"


def _braking(row: Row) -> str | None:
    needed = row["needed_braking"]
    return None if needed is None else f"{needed:.1f}" if math.isfinite(needed) else "∞"


def pair_words(row: Row) -> str:
    """Return an encounter's vehicles: who responds, who acts, and how many more respond."""
    more = f" and {row['more']} more" if row["more"] else ""
    return f"{row['other_id']} → {row['person'] or row['track_id']}{more}"


def _times_usual(row: Row) -> str | None:
    usual = usual_of(row)
    if usual is None:
        return None
    words = usual.words(row["probability"]).replace(f" the median {usual.what}", "")
    return words if usual.what == AT_SITE else f"{words} (all)"


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table as Parquet and CSV, by a path without suffix."""
    with replacing(path.with_name(f"{path.name}.parquet")) as file:
        pq.write_table(table, file, compression="zstd")
    with replacing(path.with_name(f"{path.name}.csv")) as file:
        pa_csv.write_csv(table, file)
