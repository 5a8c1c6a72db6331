"""Table files that commands write: Parquet or CSV by the name's ending."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.base.files import output

if TYPE_CHECKING:
    import pyarrow as pa

TABLE_SUFFIXES = (".parquet", ".csv")


def write_table(table: pa.Table, path: Path, *inputs: Path) -> None:
    """Write a table as Parquet or CSV, as `output`."""
    import pyarrow.parquet as pq

    with output(path, *inputs) as temporary:
        if path.suffix == ".parquet":
            pq.write_table(table, temporary)
        else:
            with temporary.open("wb") as file:
                write_csv(table, file)


def write_csv(table: pa.Table, file: Any) -> None:
    """Write a table as CSV to an open binary file."""
    from pyarrow import csv

    csv.write_csv(table, file, csv.WriteOptions(quoting_style="needed"))
    file.flush()
