"""Track sources to evaluate: recordings, files of cases, result folders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.errors import TrackError, one_line
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.datasets.recordings import read_clean
from scex_sumo.converters.tracks.check import check_values
from scex_sumo.converters.tracks.reader import tracks_of
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.scene import LOGGED_HISTORY

TEXTS = ("case_id", "track_id", "agent_type")
NUMBERS = ("frame_id", "x", "y", "vx", "vy", "psi_rad", "length", "width", "timestamp_ms")
LARGEST = {"frame_id": 1e15, "length": 1e4, "width": 1e4}


def read_source(source: Path) -> tuple[TrackTable, int]:
    """Read tracks and their number of history steps from a recording, a Parquet file or a result folder.

    Only recordings are repaired; the table's ``notes`` list the defects.

    Raises:
        ScexError: there are no tracks, or they cannot be read.
    """
    if source.is_dir():
        file = source / "tracks.parquet"
        if not file.is_file():
            raise TrackError(f"{source}: no tracks.parquet in it; give a result folder or a file with tracks")
        return read_parquet(file, arrivals=True), LOGGED_HISTORY
    if source.suffix == ".parquet":
        return read_parquet(source), 0
    table, findings, _ = read_clean([source], None)
    if table.has_cases:
        table, repairs = repair_tracks(table)
        findings = (*findings, *repairs)
    return replace(table, notes=findings), 0


def read_parquet(path: Path, *, arrivals: bool = False) -> TrackTable:
    """Read tracks with INTERACTION columns from Parquet.

    Args:
        arrivals: rows without a place are those of vehicles that have arrived, and left out.

    Raises:
        TrackError: the file, a column or a value is unusable, or a track has two rows at one time.
    """
    try:
        table = pq.read_table(path.absolute())
    except (OSError, pa.ArrowException, ValueError) as error:
        raise TrackError(f"{path}: cannot be read as Parquet: {one_line(error)[:160]}") from None
    if arrivals and "x" in table.column_names:
        table = table.filter(table["x"].is_valid())
    missing = [name for name in (*TEXTS, *NUMBERS) if name not in table.column_names]
    if missing:
        raise TrackError(f"{path}: no column {', '.join(missing)}; give tracks with INTERACTION columns")
    columns = {name: _column(path, table, name) for name in (*TEXTS, *NUMBERS)}
    if not table.num_rows:
        raise TrackError(f"{path}: no rows; give a file with tracks")
    kind, types = columns["agent_type"]
    is_vehicle = np.isin([name.lower() for name in types], list(MOTOR_TYPES))[kind]
    for name in ("length", "width"):
        if (columns[name][is_vehicle] <= 0.0).any():
            raise TrackError(f"{path}: {name} of a vehicle is not above 0 m; repair it")
    columns["agent_type"] = kind, [name.lower() for name in types]
    # The order of vehicles decides the last bits of metrics.
    tracks = tracks_of(path, [(columns, [])], by_text=True)
    stamps = np.diff(tracks.vehicles.timestamp_ms)[np.diff(tracks.vehicles.track) == 0]
    if (stamps <= 0.0).any():
        raise TrackError(f"{path}: {int((stamps <= 0.0).sum())} rows at a time that their track already has")
    if tracks.step_s < 1e-3:
        raise TrackError(
            f"{path}: stamps rise by {tracks.step_s * 1000:g} ms, needs at least 1; give them in ms"
        )
    check_values(tracks)
    return tracks


def _column(path: Path, table: pa.Table, name: str) -> Any:
    """Return numbers, or the codes of texts and these texts."""
    try:
        column = table[name].cast(pa.string() if name in TEXTS else pa.float64()).combine_chunks()
    except pa.ArrowException as error:
        raise TrackError(f"{path}: column {name}: {one_line(error)[:120]}; repair it") from None
    if column.null_count or (name not in TEXTS and not np.isfinite(column.to_numpy()).all()):
        raise TrackError(f"{path}: column {name} has missing values; fill or drop those rows")
    if name in TEXTS:
        encoded = column.dictionary_encode()
        return np.asarray(encoded.indices, np.int64), encoded.dictionary.to_pylist()
    largest = LARGEST.get(name, np.inf)
    if np.abs(column.to_numpy()).max(initial=0.0) > largest:
        raise TrackError(f"{path}: column {name} has values beyond {largest:g}; repair them")
    return column.to_numpy()
