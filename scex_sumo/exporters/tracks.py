"""Tracks of children: INTERACTION v1.2 cases, and SUMO's floating car data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv

from scex_sumo.errors import UsageError
from scex_sumo.exporters.request import Request
from scex_sumo.files import replacing, write_atomic
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.views.children import write_child


def write_interaction(request: Request) -> list[Path]:
    """All children in one file, each a case of INTERACTION v1.2."""
    run, children = request.run, np.array(request.children)
    stem = request.file_stem(children[0]) if len(children) == 1 else f"{request.name}_children"
    path = request.out if request.out is not None else Path(f"{stem}.csv")
    if path.is_dir():
        raise UsageError(f"-o {path}: is a folder; give a file.csv")
    rows = len(request.scene.track_ids) * (LOGGED_HISTORY + int(run.info["steps"]))
    cases = pa.concat_tables([run.tracks.slice(child * rows, rows) for child in children.tolist()])
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        csv.write_csv(cases, file, csv.WriteOptions(quoting_style="none", quoting_header="none"))
    return [path]


def write_fcd_files(request: Request) -> list[Path]:
    """Each child as SUMO's floating car data; several go into a folder."""
    if len(request.children) == 1:
        child = request.children[0]
        paths = [request.out or Path(f"{request.file_stem(child)}.fcd.xml")]
    else:
        paths = [request.folder / f"{request.file_stem(child)}.fcd.xml" for child in request.children]
    for child, path in zip(request.children, paths, strict=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, write_child(request.run, child).with_suffix(".fcd.xml").read_bytes())
    return paths
