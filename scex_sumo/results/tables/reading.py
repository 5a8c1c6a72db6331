"""Tables of a result folder, checked, because files are edited or truncated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.errors import ResultError, UsageError, one_line
from scex_sumo.metrics.registry import COLLISION, Metric, metric_of

if TYPE_CHECKING:
    from scex_sumo.base.arrow import ArrowTable


@contextmanager
def as_table(file: Path) -> Iterator[None]:
    """Turn errors of reading a Parquet file into a `ResultError`."""
    try:
        yield
    except (OSError, pa.ArrowException, ValueError) as error:
        raise ResultError(f"{file}: cannot be read: {one_line(error)[:160]}") from None


def read_table(file: Path, *, columns: Sequence[str] = (), rows: int | None = None) -> ArrowTable:
    """Read a Parquet file of a result, as `Run.table`."""
    with as_table(file):
        table: ArrowTable = pq.ParquetFile(file.absolute()).read()  # a relative one may be a URI to Arrow
    check_fit(file, table.column_names, columns, table.num_rows, rows)
    return table


def read_metrics(file: Path, *, rows: int | None, own: Mapping[str, Metric]) -> ArrowTable:
    """Read ``metrics.parquet``: futures in order, and numbers of known metrics or ``own`` ones."""
    table = read_table(file, columns=("future", COLLISION), rows=rows)
    if table["future"].to_pylist() != list(range(table.num_rows)):
        raise ResultError(f"{file}: its futures are not 0 to {table.num_rows - 1}; run again")
    for name in table.column_names[1:]:
        kind = table.schema.field(name).type
        if name == COLLISION and pa.types.is_boolean(kind) and not table[name].null_count:
            continue
        if not (pa.types.is_floating(kind) or pa.types.is_null(kind)):
            raise ResultError(f"{file}: column {name[:40]} holds no numbers; run again")
        try:
            metric_of(name, own)
        except UsageError:
            raise ResultError(
                f"{file}: column {name[:40]!r} is no metric that run.json describes; run again"
            ) from None
    return table


def read_assignments(file: Path, *, rows: int) -> ArrowTable:
    """Read ``assignments.parquet``."""
    table = read_table(file, columns=("future", "track_id", "model"), rows=rows)
    if not pa.types.is_string(table.schema.field("model").type) or table["model"].null_count:
        raise ResultError(f"{file}: column model holds no names; run again")
    return table


def check_fit(file: Path, columns: Sequence[str], wanted: Sequence[str], rows: int, said: int | None) -> None:
    """Raise a `ResultError` unless a table has the wanted columns, and as many rows as ``run.json`` said."""
    missing = [column for column in wanted if column not in columns]
    if missing:
        raise ResultError(
            f"{file}: column {missing[0]} is missing; the file was edited or damaged: run again"
        )
    if said not in (None, rows):
        raise ResultError(f"{file}: has {rows} rows, run.json says {said}; run again")
