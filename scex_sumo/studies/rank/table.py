"""Table of the moments of a ranking, the most critical first, failures last; columns of its tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.base.files import replacing
from scex_sumo.certainty.fitted import percent_of
from scex_sumo.certainty.response.answer import any_of, once_in
from scex_sumo.certainty.response.usual import AT_SITE, usual_of
from scex_sumo.metrics.registry import metric_of
from scex_sumo.page.study import Column, Row
from scex_sumo.results.design import column_of, is_critical
from scex_sumo.statistics.density import Interval
from scex_sumo.statistics.intervals import DesignIntervals
from scex_sumo.studies.moments.folder import Failure, MomentRef, as_row
from scex_sumo.studies.rank.encounters import FITTED
from scex_sumo.studies.rank.exact import COLLISION, CRITICAL, ExactScore
from scex_sumo.studies.rank.places import Tally, place
from scex_sumo.studies.rank.ranking_run import RankingRun
from scex_sumo.studies.rank.scores import MICRO, RankSettings, pairs_of

_ROWS_AT_ONCE = 500


def moments_table(run: RankingRun) -> pa.Table:
    """Return the moments of a ranking whose moments have all run; those without futures after those with."""
    refs, settings = run.refs, run.settings
    limits = settings.thresholds
    if not refs:
        failed = [*run.unreadable.values(), *run.failures.values()]
        reason = f"; the first of {len(failed)} failures: {failed[0].reason}" if failed else ""
        raise TrackError(
            f"none of {len(run.recordings)} recordings has a moment with {settings.min_vehicles} moving "
            f"vehicles that could be run{reason}; lower --every or --min-vehicles, or look at the recordings"
        )
    human = {ref.moment: _human_like(pairs) for ref, pairs in run.pairs}
    some = [ref for ref in refs if run.tallies.get(ref.moment)]
    rows = (
        moment_row(ref, run.parts(ref), run.tallies[ref.moment][-1], settings) | human[ref.moment]
        for ref in some
    )
    table = placed(tabulate(rows, settings), limits, seed=settings.run.seed)
    others = [as_row(ref) | {"futures": 0} | human[ref.moment] for ref in refs if ref not in some]
    rest = tabulate(others, settings).sort_by([("human_severity", "descending"), ("seed", "ascending")])
    table = pa.concat_tables([table, rest])
    names = {ref.moment for ref in refs}
    late = {name: failure.reason for name, failure in run.failures.items() if name in names}
    if late:  # their first futures ran, those of a later round did not
        reasons = pa.array([late.get(name) for name in table["seed"].to_pylist()], pa.string())
        table = table.set_column(table.schema.get_field_index("failure"), "failure", reasons)
    failed = [*run.unreadable.values()]
    failed += [failure for name, failure in sorted(run.failures.items()) if name not in names]
    return pa.concat_tables([table, tabulate(map(failed_row, failed), settings)]).combine_chunks()


def _human_like(pairs: pa.Table) -> dict[str, float]:
    """Return P of any collision and the expected severe injuries of pairs whose data are not doubtful."""
    sure = pairs.filter(pc.is_null(pairs["doubt"]))
    value, severity = any_of(sure["probability"].to_pylist()), pc.sum(sure["severity"]).as_py() or 0.0
    return {"human_p_collision": value, "human_severity": severity}


def schema(settings: RankSettings) -> pa.Schema:
    """Return the columns: rank and score, moment, human-like P, collisions, worst pair, metrics, failure."""
    whole, real, text = pa.int64(), pa.float64(), pa.string()
    fields = dict.fromkeys(("rank", "rank_low", "rank_high"), whole)
    fields |= dict.fromkeys(("score", "score_error"), real)
    fields |= dict.fromkeys(("seed", "location", "recording", "case"), text) | {"time_s": real}
    fields |= dict.fromkeys(("human_p_collision", "human_severity"), real)
    fields |= dict.fromkeys(("vehicles", "futures", "extra", "fallbacks"), whole)
    fields |= dict.fromkeys((*_ends("p_collision"), "remainder", "collisions", "encounters"), real)
    fields |= {"expected_mais3": real, "worst_track_id": whole, "worst_other_id": whole}
    fields |= dict.fromkeys(("worst_p_collision", "worst_p_critical"), real)
    fields |= {f"median_{column}": real for column in settings.run.columns}
    for column in settings.thresholds:
        fields |= dict.fromkeys((f"critical_{column}", f"defined_{column}"), whole)
        fields |= dict.fromkeys(_ends(f"p_{column}"), real)
    return pa.schema([*fields.items(), ("failure", text)])


def _ends(name: str) -> list[str]:
    return [name + end for end in ("", "_low", "_high")]


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
        Column(FITTED, "fitted", "percent", "The same with weights fitted to the recording"),
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
    """Return P(collision) in the stress test, and with fitted weights where it is known."""
    drawn, fitted = row["stress_p_collision"], row[FITTED]
    if drawn is None:
        return None
    return f"{drawn:.0%}" + ("" if fitted is None else f" ({percent_of(fitted)} fitted)")


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


def moment_row(
    ref: MomentRef, parts: Sequence[pa.Table], tally: Tally, settings: RankSettings
) -> dict[str, Any]:
    """Return the row of a moment without its rank, from its futures and their tally.

    An exact P(collision) has no interval but a ``remainder``.
    """
    futures = pa.concat_tables(parts)
    intervals = settings.intervals(futures["model"].to_pylist())
    pairs = pairs_of(futures)
    row: dict[str, Any] = as_row(ref) | {"futures": futures.num_rows}
    row |= {"score": tally.score, "score_error": tally.error, "extra": 0}
    row["fallbacks"] = int(np.asarray(futures["fallbacks"]).sum())
    row |= _outcome(pairs, intervals)
    if tally.exact is not None:
        row |= _exact(row, tally.exact)
    for column in settings.run.columns:
        values = column_of(futures, column)
        samples = values[~np.isnan(values)]
        row[f"median_{column}"] = float(np.median(samples)) if len(samples) else None
        if column in settings.thresholds:
            critical = is_critical(values, metric_of(column), settings.thresholds[column])
            row |= {f"critical_{column}": int(critical.sum()), f"defined_{column}": len(samples)}
            row |= _share(f"p_{column}", intervals.share(critical))
    return row


def _share(name: str, interval: Interval) -> dict[str, float]:
    return dict(zip(_ends(name), (interval.value, interval.low, interval.high), strict=True))


def _outcome(pairs: Sequence[IntArray], intervals: DesignIntervals) -> dict[str, Any]:
    collides = np.array([rows[:, 2].any() for rows in pairs])
    every = np.concatenate(pairs)
    row: dict[str, Any] = _share("p_collision", intervals.share(collides))
    row |= {"collisions": every[:, 2].sum() / len(pairs), "encounters": len(every) / len(pairs)}
    row["expected_mais3"] = float(every[:, 4].sum() / MICRO / len(pairs))
    if not len(every):
        return row
    both, which = np.unique(every[:, :2], axis=0, return_inverse=True)
    critical = np.bincount(which.reshape(-1))
    hits = np.bincount(which.reshape(-1), weights=every[:, 2])
    worst = int(np.lexsort((critical, hits))[-1])
    names = ("worst_track_id", "worst_other_id", "worst_p_collision", "worst_p_critical")
    shares = (hits[worst] / len(pairs), critical[worst] / len(pairs))
    return row | dict(zip(names, (*both[worst].tolist(), *shares), strict=True))


def _exact(row: Row, exact: ExactScore) -> dict[str, Any]:
    """Return the values of a row that tables make exact, or more certain."""
    known: dict[str, Any] = {"extra": exact.extra}
    if exact.p_collision is not None:
        known |= dict.fromkeys(_ends("p_collision"), exact.p_collision) | {"remainder": exact.remainder}
    for name, event in (("worst_p_collision", COLLISION), ("worst_p_critical", CRITICAL)):
        share = exact.pair(row["worst_track_id"], row["worst_other_id"], event) if name in row else None
        known |= {} if share is None else {name: share}
    return known


def failed_row(failure: Failure) -> dict[str, Any]:
    """Return the row of a moment or recording without a result."""
    return as_row(failure) | {"futures": 0, "failure": failure.reason}


def tabulate(rows: Iterable[dict[str, Any]], settings: RankSettings) -> pa.Table:
    """Return a table of rows, made of a few rows at a time."""
    wanted, waiting = schema(settings), iter(rows)
    tables = [wanted.empty_table()]
    while chunk := list(islice(waiting, _ROWS_AT_ONCE)):
        tables.append(pa.Table.from_pylist(chunk, schema=wanted))
    return pa.concat_tables(tables).combine_chunks()


def placed(table: pa.Table, thresholds: Mapping[str, float], *, seed: int) -> pa.Table:
    """Sort rows of moments by rank, the most critical first."""
    medians = np.stack([_larger_is_worse(table, column) for column in thresholds], axis=-1)
    places = place(np.asarray(table["score"]), np.asarray(table["score_error"]), severity=medians, seed=seed)
    values = {"rank": places.rank, "rank_low": places.low, "rank_high": places.high}
    for name, column in values.items():
        index = table.schema.get_field_index(name)
        table = table.set_column(index, table.schema.field(index), pa.array(column))
    return table.take(np.asarray(places.order(), dtype=np.int64))


def _larger_is_worse(table: pa.Table, column: str) -> FloatArray:
    medians = np.asarray(table[f"median_{column}"].to_numpy(zero_copy_only=False), dtype=np.float64)
    oriented = -medians if metric_of(column).side == "left" else medians
    return np.where(np.isnan(oriented), -np.inf, oriented)


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table as Parquet and CSV, by a path without suffix."""
    with replacing(path.with_name(f"{path.name}.parquet")) as file:
        pq.write_table(table, file, compression="zstd")
    with replacing(path.with_name(f"{path.name}.csv")) as file:
        pa_csv.write_csv(table, file)
