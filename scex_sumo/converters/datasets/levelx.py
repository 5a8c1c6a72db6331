"""Recordings of the levelx family: inD, rounD, exiD and highD.

A recording ``NN`` is three files: ``NN_tracks.csv``, a row for every road user and frame;
``NN_tracksMeta.csv``, what they are; ``NN_recordingMeta.csv``, frame rate and place. In inD, rounD and exiD
positions are the centres in metres from a point given in UTM, y to the north; in highD ``x, y`` is the upper
left corner of a box in the picture, y down, and ``width, height`` its sides along x and y.
"""

from __future__ import annotations

import math
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.cleaning.heading import FORWARD_MPS
from scex_sumo.converters.formats import (
    has_lane_markings,
    number,
    open_binary,
    read_meta,
    read_rows,
    recording_file,
)
from scex_sumo.converters.tracks.check import LARGEST
from scex_sumo.converters.tracks.kinds import MOTOR_TYPES, obstacle_size, with_unknown_vehicles
from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, segments_of
from scex_sumo.errors import TrackError
from scex_sumo.geometry.polylines import wrap

_IND = ("trackId", "frame", "xCenter", "yCenter", "heading", "width", "length", "xVelocity", "yVelocity")
_LARGEST = dict.fromkeys(("id", "trackId"), 2**63) | {"frame": 1e9}
_LARGEST |= dict.fromkeys(("x", "y", "xCenter", "yCenter"), LARGEST["x"])
_HIGHD = ("id", "frame", "x", "y", "width", "height", "xVelocity", "yVelocity")


def read_levelx(path: str | Path) -> TrackTable:
    """Read a recording of inD, rounD, exiD or highD; nothing is repaired.

    Headings of inD, rounD and exiD are as recorded; highD has none: they are the course of the motion, and
    the driving direction of vehicles slower than 3 m/s. In highD y is turned upwards.

    Args:
        path: ``NN_tracks.csv``; ``NN_tracksMeta.csv`` and ``NN_recordingMeta.csv`` lie beside it.

    Raises:
        TrackError: a file or column is missing, a value is missing or not a number, or there are no rows.
    """
    path = Path(path)
    meta = read_meta(recording_file(path, "recordingMeta"))
    rate_hz = number(meta.get("frameRate"))
    if not 0.0 < rate_hz <= 1000.0:
        where = recording_file(path, "recordingMeta")
        raise TrackError(f"{where}: frameRate is {meta.get('frameRate')!r}; frames per second expected")
    highd = has_lane_markings(meta)
    columns = _read_columns(path, _HIGHD if highd else _IND)
    of_track = _track_meta(recording_file(path, "tracksMeta"), "id" if highd else "trackId")
    flat = _highd(columns, of_track, path) if highd else _ind(columns)
    order = np.lexsort((flat["frame"], flat["id"]))
    flat = {name: values[order] for name, values in flat.items()}
    kind = {number: of_track[number]["class"].strip().lower() for number in of_track}
    ids: IntArray = flat.pop("id").astype(np.int64)
    missing = [int(number) for number in np.unique(ids) if int(number) not in kind]
    if missing:
        where = recording_file(path, "tracksMeta")
        raise TrackError(f"{where}: no row for track {missing[0]}; take the files as published")
    frame: IntArray = flat.pop("frame").astype(np.int64)
    flat_kind, notes = _kinds(ids, kind, flat)
    motor = np.array([flat_kind[int(number)] in MOTOR_TYPES for number in ids], bool)
    return TrackTable(
        path=path,
        cases=("",),
        vehicles=_rows(flat, ids, frame, flat_kind, rate_hz, motor),
        others=_rows(flat, ids, frame, flat_kind, rate_hz, ~motor),
        step_s=1.0 / rate_hz,
        notes=notes,
    )


def _kinds(
    ids: IntArray, kind: dict[int, str], flat: dict[str, FloatArray]
) -> tuple[dict[int, str], tuple[str, ...]]:
    """Types by id, and what was found of unknown ones."""
    numbers, track = np.unique(ids, return_inverse=True)
    types = sorted(set(kind.values()))
    given = np.array([types.index(kind[int(number)]) for number in numbers], np.int64)
    speed = np.hypot(flat["vx"], flat["vy"])
    found, notes = with_unknown_vehicles(types, given, track, flat["length"], flat["width"], speed)
    return {int(number): types[k] for number, k in zip(numbers, found, strict=True)}, notes


def _ind(columns: dict[str, Any]) -> dict[str, Any]:
    return {
        "id": columns["trackId"],
        "frame": columns["frame"],
        "x": columns["xCenter"],
        "y": columns["yCenter"],
        "vx": columns["xVelocity"],
        "vy": columns["yVelocity"],
        "psi_rad": wrap(np.radians(columns["heading"])),
        "length": columns["length"],
        "width": columns["width"],
    }


def _highd(columns: dict[str, Any], of_track: dict[int, dict[str, str]], path: Path) -> dict[str, FloatArray]:
    vx, vy = columns["xVelocity"], -columns["yVelocity"]
    ways = {i: number(row.get("drivingDirection")) for i, row in of_track.items()}
    if not set(ways.values()) <= {1.0, 2.0}:
        raise TrackError(f"{recording_file(path, 'tracksMeta')}: drivingDirection is not 1 or 2 everywhere")
    # 1: the upper lanes, to the left
    along = np.array([math.pi if ways.get(int(number)) == 1.0 else 0.0 for number in columns["id"]])
    fast = np.hypot(vx, vy) > FORWARD_MPS
    return {
        "id": columns["id"],
        "frame": columns["frame"],
        "x": columns["x"] + columns["width"] / 2.0,
        "y": -(columns["y"] + columns["height"] / 2.0),
        "vx": vx,
        "vy": vy,
        "psi_rad": np.where(fast, np.arctan2(vy, vx), along),
        "length": columns["width"],
        "width": columns["height"],
    }


def _rows(
    flat: dict[str, FloatArray],
    ids: IntArray,
    frame: IntArray,
    kind: dict[int, str],
    rate_hz: float,
    keep: BoolArray,
) -> TrackRows:
    """Rows of vehicles, or of others; sizes that others lack are usual ones."""
    numbers, track = np.unique(ids[keep], return_inverse=True)
    kinds = tuple(kind[int(number)] for number in numbers)
    usual = np.array([obstacle_size(name) for name in kinds]).reshape(-1, 2)
    columns = {name: values[keep] for name, values in flat.items()}
    for name, size in (("length", usual[:, :1]), ("width", usual[:, 1:])):
        columns[name] = np.where(columns[name] > 0.0, columns[name], size[track, 0])
    stamps = np.asarray(1000.0 * frame[keep] / rate_hz, np.float64)
    return TrackRows(
        **columns,
        case=np.zeros(len(track), np.int64),
        track=track.astype(np.int64),
        segment=segments_of(track.astype(np.int64), stamps),
        labels=tuple(str(number) for number in numbers),
        types=kinds,
        frame_id=frame[keep],
        timestamp_ms=stamps,
    )


def _track_meta(path: Path, id_column: str) -> dict[int, dict[str, str]]:
    rows = read_rows(path)
    for name in (id_column, "class"):
        if rows and name not in rows[0]:
            raise TrackError(f"{path}: no column {name}; take the file as published")
    found = {}
    for line, row in enumerate(rows, start=2):
        own = number(row[id_column])
        if not own.is_integer():
            raise TrackError(f"{path}: line {line}: {id_column} is {row[id_column]!r}, not an integer")
        found[int(own)] = row
    return found


def _read_columns(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """The named columns as numbers.

    Raises:
        TrackError: file or column missing, a value that is no finite number, or no rows.
    """
    import pyarrow as pa
    from pyarrow import csv as fast

    options: Any = fast.ConvertOptions(
        include_columns=list(names),
        column_types={name: pa.int64() if name in ("id", "trackId") else pa.float64() for name in names},
    )
    try:
        with open_binary(path) as file:
            arrow = fast.read_csv(file, convert_options=options)
    except FileNotFoundError:
        raise TrackError(f"{path}: no such file; check the path of the tracks") from None
    except pa.ArrowKeyError as error:
        name = re.sub(r".*'(.*)'.*", r"\1", str(error).splitlines()[0])
        raise TrackError(f"{path}: no column {name}; such tracks have {', '.join(names)}") from None
    except (pa.ArrowInvalid, OSError, EOFError, zlib.error) as error:
        raise TrackError(f"{path}: cannot be read ({str(error).splitlines()[0][:160]})") from None
    # An id stays an integer; one that is missing makes the column floats, and an error below.
    columns = {name: np.array(arrow[name].to_numpy()) for name in names}
    if not arrow.num_rows:
        raise TrackError(f"{path}: a header and no rows; give a file with tracks")
    for name, values in columns.items():
        largest = _LARGEST.get(name, LARGEST["vx"])
        bad = ~(np.abs(values) <= largest)
        if bad.any():
            row = int(np.argmax(bad))
            what = f"beyond {largest:g}" if np.isfinite(values[row]) else "missing or not finite"
            raise TrackError(f"{path}: line {row + 2}: {name} is {what}; repair or drop the row")
    return columns
