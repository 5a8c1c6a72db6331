"""Tracks of children: INTERACTION v1.2 cases, a submission to INTERPRET, floating car data of SUMO."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import replacing
from scex_sumo.exporters.request import Request
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.views.children import write_child

_CHILDREN_AT_ONCE = 100
_PREDICTED_STEPS, _MODALITIES = 30, 6  # of INTERPRET


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


def write_interpret(request: Request) -> list[Path]:
    """Write up to six children as the modalities of one case of the INTERPRET challenge (multi-agent).

    Modality 1 counts as the likeliest one. All vehicles are to be predicted, and none is the ego.
    """
    scene, info = request.scene, request.run.info
    if info["steps"] < _PREDICTED_STEPS:
        raise UsageError(
            f"{request.run.folder}: has {info['steps']} steps; a submission needs 30, so run with 3 s"
        )
    path = request.file(f"{scene.location}_sub", ".csv")
    count, frames = scene.vehicles, LOGGED_HISTORY + np.arange(1, _PREDICTED_STEPS + 1)
    frame = np.tile(frames, count)
    columns = {
        "case_id": np.full(len(frame), float(scene.source.get("case") or 1)),
        "track_id": np.repeat(scene.track_ids, _PREDICTED_STEPS),
        "frame_id": frame,
        "timestamp_ms": 100 * frame,
        "track_to_predict": np.ones(len(frame), dtype=np.int64),
        "interesting_agent": np.zeros(len(frame), dtype=np.int64),
    }
    for number, child in enumerate(request.children[:_MODALITIES], start=1):
        states = request.run.states(child)[:, frames - 1]
        for name, values in (("x", states.x), ("y", states.y), ("psi_rad", states.heading)):
            columns[f"{name}{number}"] = values.ravel()
    with replacing(path) as file:
        csv.write_csv(pa.table(columns), file)
    return [path]


def write_fcd_files(request: Request) -> list[Path]:
    """Write each child as SUMO's floating car data; several into a folder."""
    return request.write_each(
        ".fcd.xml", lambda child: write_child(request.run, child).with_suffix(".fcd.xml").read_bytes()
    )
