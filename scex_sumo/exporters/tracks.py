"""Tracks of children: INTERACTION v1.2 cases, and floating car data of SUMO."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import replacing
from scex_sumo.exporters.request import Request
from scex_sumo.results.run import Run
from scex_sumo.views.children import write_child

_CHILDREN_AT_ONCE = 100


def write_interaction(request: Request) -> list[Path]:
    """Write all children into one file, each a case of INTERACTION v1.2."""
    run, children = request.run, request.children
    stem = request.file_stem(children[0]) if len(children) == 1 else f"{request.name}_children"
    path = request.file(stem, ".csv")
    options = csv.WriteOptions(quoting_style="none", quoting_header="none")
    schema = pq.read_schema(run.folder / "tracks.parquet")
    with replacing(path) as file, csv.CSVWriter(file, schema, write_options=options) as writer:
        for first in range(0, len(children), _CHILDREN_AT_ONCE):
            for case in _cases(run, children[first : first + _CHILDREN_AT_ONCE]):
                writer.write_table(case)
    return [path]


def _cases(run: Run, children: Sequence[int]) -> Iterator[pa.Table]:
    file, ordered = run.folder / "tracks.parquet", sorted(children)
    table = pq.read_table(file, filters=[("case_id", "in", ordered)])
    rows = run.states(children[0]).x.size
    if table.num_rows != rows * len(ordered):
        raise ResultError(f"{file}: does not have {rows} rows of each future; run again")
    for child in children:
        yield table.slice(ordered.index(child) * rows, rows)


def write_fcd_files(request: Request) -> list[Path]:
    """Write each child as SUMO's floating car data; several into a folder."""
    return request.write_each(
        ".fcd.xml", lambda child: write_child(request.run, child).with_suffix(".fcd.xml").read_bytes()
    )
