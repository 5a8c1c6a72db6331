"""Tracks of futures: INTERACTION v1.2 cases, a submission to INTERPRET, floating car data of SUMO."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from pyarrow import csv

from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.exporters.request import Request
from scex_sumo.scene import LOGGED_HISTORY, SeedScene
from scex_sumo.views.futures import write_future

_AT_ONCE = 100  # futures
_PREDICTED_STEPS, _MODALITIES = 30, 6  # of INTERPRET


def write_interaction(request: Request) -> list[Path]:
    """Write all futures into one file, each a case of INTERACTION v1.2."""
    run, futures = request.run, request.futures
    stem = request.file_stem(futures[0]) if len(futures) == 1 else f"{request.name}_futures"
    path = request.file(stem, ".csv")
    options = csv.WriteOptions(quoting_style="none", quoting_header="none")
    tracks = run.folder / "tracks.parquet"
    schema = pq.read_schema(tracks)
    with request.output(path) as file, csv.CSVWriter(file, schema, write_options=options) as writer:
        rows = run.states(futures[0]).x.size
        for batch in (sorted(futures[k : k + _AT_ONCE]) for k in range(0, len(futures), _AT_ONCE)):
            table = pq.read_table(tracks, filters=[("case_id", "in", batch)])
            if table.num_rows != rows * len(batch):
                raise ResultError(f"{tracks}: does not have {rows} rows of each future; run again")
            writer.write_table(table.filter(table["x"].is_valid()))
    return [path]


def write_interpret(request: Request) -> list[Path]:
    """Write up to six futures as the modalities of one case of the INTERPRET challenge (multi-agent).

    Modality 1 counts as the likeliest one. The recording's columns ``track_to_predict`` and
    ``interesting_agent`` say which vehicles are predicted, and which is the ego. Without them all vehicles
    are predicted, and `Request.ego` is the ego. A scenario's file holds all of its cases: a file that exists
    keeps its other cases.

    Raises:
        UsageError: futures below 3 s, no recording, or an existing file with other columns.
        ResultError: the recording marks a vehicle that the run does not have.

    Source: README of github.com/interaction-dataset/INTERPRET_challenge_multi-agent.
    """
    scene, info = request.scene, request.run.info
    if info["steps"] < _PREDICTED_STEPS:
        has = f"{request.run.folder}: has {info['steps']} steps"
        raise UsageError(f"{has}; a submission needs 30, so run with 3 s")
    seed = info["seed_scene"]
    case = _case_number(seed["source"].get("case") or "1")
    path = request.file(f"{seed['location']}_sub", ".csv")
    vehicles, ego = _interpret_marks(scene, seed["source"])
    ego = scene.track_ids == request.ego if request.ego is not None else ego
    count, frames = len(vehicles), LOGGED_HISTORY + np.arange(1, _PREDICTED_STEPS + 1)
    frame = np.tile(frames, count)
    columns = {
        "case_id": np.full(len(frame), case),
        "track_id": np.repeat(scene.track_ids[vehicles], _PREDICTED_STEPS),
        "frame_id": frame,
        "timestamp_ms": 100 * frame,
        "track_to_predict": np.ones(len(frame), dtype=np.int64),
        "interesting_agent": np.repeat(ego[vehicles].astype(np.int64), _PREDICTED_STEPS),
    }
    for number, future in enumerate(request.futures[:_MODALITIES], start=1):
        states = request.run.states(future)[vehicles][:, frames - 1]
        for name, values in (("x", states.x), ("y", states.y), ("psi_rad", states.heading)):
            columns[f"{name}{number}"] = values.ravel()
    table = pa.table(columns)
    if path.is_file():
        table = _with_other_cases(path, table, case)
    with request.output(path) as file:
        csv.write_csv(table, file)
    return [path]


def _case_number(case: str) -> float:
    try:
        return float(case)
    except ValueError:
        raise UsageError(f"case {case}: cases of INTERPRET are numbers") from None


def _interpret_marks(scene: SeedScene, source: Mapping[str, Any]) -> tuple[IntArray, BoolArray]:
    """Return the vehicles to predict, and (V,) which one is the ego, as the recording marks them."""
    if "to_predict" not in source:
        return np.arange(scene.vehicles), np.zeros(scene.vehicles, dtype=np.bool_)
    labels = list(map(str, scene.track_ids.tolist()))
    if missing := sorted(set(source["to_predict"]) - set(labels)):
        raise ResultError(f"vehicle {missing[0]} is to be predicted, but the run does not have it")
    to_predict, ego = (np.isin(labels, source[name]) for name in ("to_predict", "interesting"))
    return np.flatnonzero(to_predict), ego


def _with_other_cases(path: Path, table: pa.Table, case: float) -> pa.Table:
    try:
        rest = csv.read_csv(path)
    except pa.ArrowInvalid as error:
        raise UsageError(f"{path}: not a submission to INTERPRET ({error}); give another file") from None
    if rest.column_names != table.column_names:
        has = f"{path}: has other columns than {table.num_columns} of this case"
        raise UsageError(f"{has}; give another file")
    rest = rest.cast(table.schema)
    return pa.concat_tables([rest.filter(pc.not_equal(rest["case_id"], case)), table])


def write_fcd_files(request: Request) -> list[Path]:
    """Write each future as SUMO's floating car data, and its vehicle types beside it; several into a folder.

    SUMO replays them with ``-a X.types.add.xml --device.fcd-replay.files X.fcd.xml``.
    """
    files = []
    for future, path in zip(request.futures, request.files(".fcd.xml"), strict=True):
        view = write_future(request.run, future)
        types = [line for line in view.with_suffix(".add.xml").read_text().splitlines() if "<vType " in line]
        beside = path.with_name(f"{path.name.removesuffix('.xml').removesuffix('.fcd')}.types.add.xml")
        request.write(path, view.with_suffix(".fcd.xml").read_bytes())
        request.write(beside, "\n".join(["<additional>", *types, "</additional>\n"]).encode())
        files += [path, beside]
    return files
