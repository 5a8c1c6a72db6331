"""The table of a ranking: one row for each seed, the most critical first, then what failed."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq

from scex_sumo.density import p_critical
from scex_sumo.metrics.evaluate import COLUMNS
from scex_sumo.ranking.scores import Places
from scex_sumo.ranking.seeds import Failure, SeedRef
from scex_sumo.results import write_atomic
from scex_sumo.run import side_of

PARQUET, CSV = "ranking.parquet", "ranking.csv"


def schema(thresholds: Mapping[str, float]) -> pa.Schema:
    """The columns: places, the seed, the medians of the 12 metrics, shares of critical children, failure."""
    fields = [("rank", pa.int64()), ("rank_low", pa.int64()), ("rank_high", pa.int64())]
    fields += [("score", pa.float64())]
    fields += [(name, pa.string()) for name in ("seed", "location", "recording", "case")]
    fields += [("time_s", pa.float64()), ("vehicles", pa.int64()), ("children", pa.int64())]
    fields += [(f"median_{column}", pa.float64()) for column in COLUMNS]
    for column in thresholds:
        fields += [(f"critical_{column}", pa.int64()), (f"defined_{column}", pa.int64())]
        fields += [(f"p_{column}{end}", pa.float64()) for end in ("", "_low", "_high")]
    return pa.schema([*fields, ("failure", pa.string())])


def seed_row(
    ref: SeedRef, parts: Sequence[pa.Table], place: tuple[Places, int], thresholds: Mapping[str, float]
) -> dict[str, Any]:
    """The row of a seed.

    Args:
        ref: the seed.
        parts: its children.
        place: all places, and the seed's index in them.
        thresholds: by metric column.
    """
    places, i = place
    row: dict[str, Any] = {
        "rank": int(places.rank[i]),
        "rank_low": int(places.low[i]),
        "rank_high": int(places.high[i]),
        "score": float(places.score[i]),
        "seed": ref.seed,
        "location": ref.location,
        "recording": ref.recording,
        "case": ref.case,
        "time_s": ref.time_s,
        "vehicles": ref.vehicles,
        "children": sum(part.num_rows for part in parts),
    }
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
    """The row of a seed, or recording, that has no result."""
    names = ("seed", "location", "recording", "case", "time_s", "vehicles")
    return {**{name: getattr(failure, name) for name in names}, "children": 0, "failure": failure.reason}


def write_ranking(folder: Path, rows: Sequence[dict[str, Any]], thresholds: Mapping[str, float]) -> pa.Table:
    """Write the table as Parquet and CSV, and return it."""
    table = pa.Table.from_pylist(list(rows), schema=schema(thresholds))
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    write_atomic(folder / PARQUET, sink.getvalue())
    sink = io.BytesIO()
    pa_csv.write_csv(table, sink)
    write_atomic(folder / CSV, sink.getvalue())
    return table
