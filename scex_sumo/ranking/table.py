"""Table of a ranking: one row for each moment, the most critical first, then what failed."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from scex_sumo.arrays import FloatArray
from scex_sumo.errors import TrackError
from scex_sumo.files import write_atomic
from scex_sumo.metrics.registry import COLUMNS, side_of
from scex_sumo.ranking.moments import Failure, MomentRef, as_row
from scex_sumo.ranking.places import place
from scex_sumo.ranking.ranking_run import RankingRun
from scex_sumo.statistics.density import p_critical

PARQUET, CSV = "ranking.parquet", "ranking.csv"
_ROWS_AT_ONCE = 500


def ranking_table(run: RankingRun) -> pa.Table:
    """Table of a ranking whose moments have all run.

    Raises:
        TrackError: no moment has a result.
    """
    refs, settings = run.refs, run.settings
    limits = settings.thresholds
    if not refs:
        failed = [*run.unreadable.values(), *run.failures.values()]
        reason = f"; the first of {len(failed)} failures: {failed[0].reason}" if failed else ""
        raise TrackError(
            f"none of {len(run.recordings)} recordings has a moment with {settings.min_vehicles} moving "
            f"vehicles that could be run{reason}; lower --min-vehicles or look at the recordings"
        )
    rows = (moment_row(ref, run.parts(ref), limits) for ref in refs)
    table = placed(tabulate(rows, limits), limits, seed=settings.seed)
    known = {ref.moment for ref in refs}
    late = {name: failure.reason for name, failure in run.failures.items() if name in known}
    if late:  # they have their first children, but not those that were asked for later
        reasons = pa.array([late.get(name) for name in table["seed"].to_pylist()], pa.string())
        table = table.set_column(table.schema.get_field_index("failure"), "failure", reasons)
    failed = [*run.unreadable.values()]
    failed += [failure for name, failure in sorted(run.failures.items()) if name not in known]
    return pa.concat_tables([table, tabulate(map(failed_row, failed), limits)]).combine_chunks()


def schema(thresholds: Mapping[str, float]) -> pa.Schema:
    """Columns: places, the moment, the medians of the 12 metrics, shares of critical children, failure."""
    fields = [("rank", pa.int64()), ("rank_low", pa.int64()), ("rank_high", pa.int64())]
    fields += [("score", pa.float64())]
    fields += [(name, pa.string()) for name in ("seed", "location", "recording", "case")]
    fields += [("time_s", pa.float64()), ("vehicles", pa.int64()), ("children", pa.int64())]
    fields += [("fallbacks", pa.int64())]
    fields += [(f"median_{column}", pa.float64()) for column in COLUMNS]
    for column in thresholds:
        fields += [(f"critical_{column}", pa.int64()), (f"defined_{column}", pa.int64())]
        fields += [(f"p_{column}{end}", pa.float64()) for end in ("", "_low", "_high")]
    return pa.schema([*fields, ("failure", pa.string())])


def moment_row(ref: MomentRef, parts: Sequence[pa.Table], thresholds: Mapping[str, float]) -> dict[str, Any]:
    """Row of a moment, but for its place.

    Args:
        ref: the moment.
        parts: its children.
        thresholds: by metric column.
    """
    row: dict[str, Any] = as_row(ref) | {"children": sum(part.num_rows for part in parts)}
    row["fallbacks"] = sum(int(np.asarray(part["fallbacks"]).sum()) for part in parts)
    for column in COLUMNS:
        chunks = [np.asarray(part[column].drop_null(), dtype=np.float64) for part in parts]
        samples = np.concatenate(chunks)
        row[f"median_{column}"] = float(np.median(samples)) if len(samples) else None
        if column in thresholds:
            share = p_critical(samples, thresholds[column], side=side_of(column))
            found = share.value if share.count else None
            row[f"critical_{column}"] = round(share.value * share.count) if share.count else 0
            row[f"defined_{column}"] = share.count
            row |= {f"p_{column}": found, f"p_{column}_low": share.low, f"p_{column}_high": share.high}
    return row


def failed_row(failure: Failure) -> dict[str, Any]:
    """Row of a moment, or recording, that has no result."""
    return as_row(failure) | {"children": 0, "failure": failure.reason}


def tabulate(rows: Iterable[dict[str, Any]], thresholds: Mapping[str, float]) -> pa.Table:
    """Rows as a table; they are made and taken a few at a time."""
    wanted, waiting = schema(thresholds), iter(rows)
    tables = [wanted.empty_table()]
    while chunk := list(islice(waiting, _ROWS_AT_ONCE)):
        tables.append(pa.Table.from_pylist(chunk, schema=wanted))
    return pa.concat_tables(tables).combine_chunks()


def placed(table: pa.Table, thresholds: Mapping[str, float], *, seed: int) -> pa.Table:
    """The rows of moments with their places, the most critical first; equals in the order given.

    Args:
        table: rows of moments, as `moment_row` makes them.
        thresholds: by metric column.
        seed: of the draws of the intervals.
    """
    critical = np.stack([np.asarray(table[f"critical_{c}"]) for c in thresholds], axis=-1)
    medians = np.stack([_larger_is_worse(table, column) for column in thresholds], axis=-1)
    children = np.asarray(table["children"])
    found = place(critical, children, severity=medians, seed=seed)
    values = {"rank": found.rank, "rank_low": found.low, "rank_high": found.high, "score": found.score}
    for name, column in values.items():
        index = table.schema.get_field_index(name)
        table = table.set_column(index, table.schema.field(index), pa.array(column))
    return table.take(np.asarray(found.order()))


def _larger_is_worse(table: pa.Table, column: str) -> FloatArray:
    medians = np.asarray(table[f"median_{column}"].to_numpy(zero_copy_only=False), dtype=np.float64)
    oriented = -medians if side_of(column) == "left" else medians
    return np.where(np.isnan(oriented), -np.inf, oriented)


def write_ranking(folder: Path, table: pa.Table) -> None:
    """Write the table as Parquet and CSV."""
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    write_atomic(folder / PARQUET, sink.getvalue())
    sink = io.BytesIO()
    pa_csv.write_csv(table, sink)
    write_atomic(folder / CSV, sink.getvalue())
