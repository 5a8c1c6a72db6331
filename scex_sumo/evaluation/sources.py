"""Sources of tracks to evaluate: recordings, files of cases, result folders."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.arrays import BoolArray
from scex_sumo.converters.tracks.reader import MOTOR_TYPES, TrackRows, TrackTable, read_tracks, segments_of
from scex_sumo.errors import TrackError
from scex_sumo.scene import LOGGED_HISTORY


def read_source(source: Path) -> tuple[TrackTable, int]:
    """Tracks of an INTERACTION file (CSV or Parquet) or a result folder, and its steps of history."""
    if not source.is_dir():
        return (read_tracks(source), 0) if source.suffix != ".parquet" else (read_parquet(source), 0)
    file = source / "tracks.parquet"
    if not file.is_file():
        raise TrackError(f"{source}: no tracks.parquet in it; give a result folder or a file with tracks")
    return read_parquet(file), LOGGED_HISTORY


def read_parquet(path: Path) -> TrackTable:
    """Tracks with INTERACTION columns as Parquet, as in result folders."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise TrackError(f"{path}: cannot be read as Parquet: {error}") from None
    floats = ("x", "y", "vx", "vy", "psi_rad", "length", "width", "timestamp_ms")
    needed = ("case_id", "track_id", "frame_id", "agent_type", *floats)
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise TrackError(f"{path}: no column {', '.join(missing)}; give tracks with INTERACTION columns")
    columns: dict[str, Any] = {name: np.asarray(table[name]) for name in needed if name != "agent_type"}
    for name in floats:
        columns[name] = columns[name].astype(np.float64)
        if not np.isfinite(columns[name]).all():
            raise TrackError(f"{path}: column {name} has missing values; fill or drop those rows")
    types, kind = np.unique(np.asarray(table["agent_type"]).astype(str), return_inverse=True)
    is_vehicle = np.isin(np.char.lower(types), list(MOTOR_TYPES))[kind]
    cases, case = np.unique(columns["case_id"], return_inverse=True)
    names, name_of = np.unique(columns["track_id"].astype(str), return_inverse=True)
    for name in names[np.unique(name_of[is_vehicle])].tolist():
        if not re.fullmatch(r"-?\d+(\.0*)?", name):
            raise TrackError(f"{path}: track_id {name!r} of a vehicle is not an integer; number the vehicles")

    def rows(keep: BoolArray) -> TrackRows:
        order = np.lexsort((columns["timestamp_ms"], name_of, case))
        order = order[keep[order]]
        ids, at = name_of[order], case[order]
        first = np.ones(len(order), dtype=bool)
        first[1:] = (np.diff(ids) != 0) | (np.diff(at) != 0)
        track = (np.cumsum(first) - 1).astype(np.int64)
        flat = {name: columns[name][order] for name in floats}
        return TrackRows(
            case=at.astype(np.int64),
            track=track,
            segment=segments_of(track, flat["timestamp_ms"]),
            labels=tuple(names[ids[first]].tolist()),
            types=tuple(np.char.lower(types)[kind[order][first]].tolist()),
            frame_id=columns["frame_id"][order].astype(np.int64),
            **flat,
        )

    vehicles = rows(is_vehicle)
    stamps = np.diff(vehicles.timestamp_ms)[np.diff(vehicles.track) == 0]
    return TrackTable(
        path=path,
        cases=tuple(str(name) for name in cases.tolist()),
        vehicles=vehicles,
        others=rows(~is_vehicle),
        step_s=float(np.median(stamps)) / 1000 if len(stamps) else 0.1,
    )
