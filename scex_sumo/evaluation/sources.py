"""Sources of tracks to evaluate: recordings, files of cases, result folders."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.arrays import BoolArray
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.datasets.reader import read_clean
from scex_sumo.converters.tracks.check import check_values
from scex_sumo.converters.tracks.kinds import MOTOR_TYPES
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, segments_of
from scex_sumo.errors import TrackError, one_line
from scex_sumo.scene import LOGGED_HISTORY


def read_source(source: Path, *, repair: bool = True) -> tuple[TrackTable, int]:
    """Tracks of a recording, of such tracks as Parquet or of a result folder, and its steps of history.

    Recordings are repaired as `run` repairs them, cases all together, and what was found is in the table's
    ``notes``; Parquet and result folders are taken as they are.

    Args:
        source: a file, or a result folder.
        repair: whether recordings are repaired.

    Raises:
        ScexError: there are no tracks, or they cannot be read.
    """
    if source.is_dir():
        file = source / "tracks.parquet"
        if not file.is_file():
            raise TrackError(f"{source}: no tracks.parquet in it; give a result folder or a file with tracks")
        return read_parquet(file), LOGGED_HISTORY
    if source.suffix == ".parquet":
        return read_parquet(source), 0
    clean = read_clean([source], None, repair=repair)
    table, findings = clean.table, clean.findings
    if repair and table.has_cases:
        table, more = repair_tracks(table)
        findings = (*findings, *more)
    return replace(table, notes=findings), 0


def read_parquet(path: Path) -> TrackTable:
    """Tracks with INTERACTION columns as Parquet, as in result folders.

    Raises:
        TrackError: it cannot be read, or a column is missing, of another kind, or without a value somewhere,
            or a track is in two places at a time.
    """
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException, ValueError) as error:
        raise TrackError(f"{path}: cannot be read as Parquet: {one_line(error)[:160]}") from None
    floats = ("x", "y", "vx", "vy", "psi_rad", "length", "width", "timestamp_ms")
    needed = ("case_id", "track_id", "frame_id", "agent_type", *floats)
    missing = [name for name in needed if name not in table.column_names]
    if missing:
        raise TrackError(f"{path}: no column {', '.join(missing)}; give tracks with INTERACTION columns")
    columns: dict[str, Any] = {}
    for name in needed:
        words = name in ("case_id", "track_id", "agent_type")
        try:
            column = table[name].cast(pa.string() if words else pa.float64()).combine_chunks()
        except pa.ArrowException as error:
            raise TrackError(f"{path}: column {name}: {one_line(error)[:120]}; repair it") from None
        if column.null_count or (not words and not np.isfinite(column.to_numpy()).all()):
            raise TrackError(f"{path}: column {name} has missing values; fill or drop those rows")
        columns[name] = column.to_numpy(zero_copy_only=False)
    if not table.num_rows:
        raise TrackError(f"{path}: no rows; give a file with tracks")
    types, kind = np.unique(np.char.lower(columns["agent_type"].astype(str)), return_inverse=True)
    is_vehicle = np.isin(types, list(MOTOR_TYPES))[kind]
    case_of = table["case_id"].combine_chunks()
    cases, case = np.unique(case_of.to_numpy(zero_copy_only=False), return_inverse=True)
    names, name_of = np.unique(columns["track_id"].astype(str), return_inverse=True)
    for name in names[np.unique(name_of[is_vehicle])].tolist():
        if not re.fullmatch(r"-?\d{1,18}(\.0*)?", name):
            raise TrackError(
                f"{path}: track_id {name[:24]!r} of a vehicle is not an integer; number the vehicles"
            )

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
            types=tuple(types[kind[order][first]].tolist()),
            frame_id=columns["frame_id"][order].astype(np.int64),
            **flat,
        )

    vehicles = rows(is_vehicle)
    stamps = np.diff(vehicles.timestamp_ms)[np.diff(vehicles.track) == 0]
    if (stamps <= 0.0).any():
        raise TrackError(f"{path}: {int((stamps <= 0.0).sum())} rows at a time that their track already has")
    found = TrackTable(
        path=path,
        cases=tuple(str(name) for name in cases.tolist()),
        vehicles=vehicles,
        others=rows(~is_vehicle),
        step_s=float(np.median(stamps)) / 1000 if len(stamps) else 0.1,
    )
    check_values(found)
    return found
