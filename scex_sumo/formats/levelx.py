"""Recordings of inD, rounD, exiD and highD; highD's map, a straight motorway from its lane markings.

Positions are centres in metres from a UTM point, y to the north. In highD ``x, y`` is the upper left corner
of a box in the picture, y down, and ``width, height`` are its sides.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.lanelet.file import read_map_file
from scex_sumo.converters.lanelet.origin import Place, on_earth
from scex_sumo.converters.lanelet.projection import distance_m, to_degrees
from scex_sumo.converters.lanelet.tags import GERMANY
from scex_sumo.converters.naming import (
    in_arrow,
    map_name,
    number,
    open_binary,
    open_text,
    plain_or_packed,
    unpacked_name,
)
from scex_sumo.converters.registries import (
    Dataset,
    MapFormat,
    Recording,
    place_name,
    recording_name,
    with_notes,
)
from scex_sumo.converters.tracks.check import MAX_VALUES, refuse_values
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES, fill_sizes
from scex_sumo.converters.tracks.rows import FORWARD_MPS, TrackTable
from scex_sumo.converters.tracks.unknown import with_unknown_vehicles
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road
from scex_sumo.formats.recognition import LEVELX_META, LEVELX_TRACKS, is_highd_map, is_levelx, levelx_file
from scex_sumo.formats.samples.build import track_table
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road

LOCATION_M = 100_000.0  # an origin farther from the recording's location is a mistake, or of another zone
_IND = {"id": "trackId", "frame": "frame", "x": "xCenter", "y": "yCenter", "psi_rad": "heading"}
_IND |= {"width": "width", "length": "length", "vx": "xVelocity", "vy": "yVelocity"}
_UPPER, _LOWER = "upperLaneMarkings", "lowerLaneMarkings"  # of highD, which has no place
_HIGHD = ("id", "frame", "x", "y", "width", "height", "xVelocity", "yVelocity")
_MAX = dict.fromkeys(("id", "trackId"), 2**63) | {"frame": 1e9}
_MAX |= dict.fromkeys(("x", "y", "xCenter", "yCenter"), MAX_VALUES["x"])

FILMED_M = 420.0
"""Length of road in a highD picture, as published; x runs from 0 to there."""
BEYOND_M = 150.0
"""Straight extension at both ends: 180 km/h drives so far in 3 s."""
_POINT_M = 10.0


def read_levelx(path: str | Path) -> TrackTable:
    """Read ``NN_tracks.csv`` with its two ``Meta`` files; nothing is repaired.

    highD has no headings: they are the course of the motion, and the driving direction below 3 m/s.
    """
    path = Path(path)
    meta = read_meta(levelx_file(path, "recordingMeta"))
    rate_hz = number(meta.get("frameRate"))
    if not 0.0 < rate_hz <= 1000.0:
        where = levelx_file(path, "recordingMeta")
        raise TrackError(f"{where}: frameRate is {meta.get('frameRate')!r}; frames per second expected")
    highd = _LOWER in meta
    columns = _read_columns(path, _HIGHD if highd else tuple(_IND.values()))
    of_track = _track_meta(levelx_file(path, "tracksMeta"), "id" if highd else "trackId")
    if highd:
        flat = _highd(columns, of_track, path)
    else:
        flat = {name: columns[theirs] for name, theirs in _IND.items()}
        flat["psi_rad"] = wrap(np.radians(flat["psi_rad"]))
    order = np.lexsort((flat["frame"], flat["id"]))
    flat = {name: values[order] for name, values in flat.items()}
    kind = {number: of_track[number]["class"].strip().lower() for number in of_track}
    ids: IntArray = flat.pop("id").astype(np.int64)
    missing = [int(number) for number in np.unique(ids) if int(number) not in kind]
    if missing:
        where = levelx_file(path, "tracksMeta")
        raise TrackError(f"{where}: no row for track {missing[0]}; take the files as published")
    frame: IntArray = flat.pop("frame").astype(np.int64)
    numbers, track = np.unique(ids, return_inverse=True)
    types, given = np.unique([kind[number] for number in numbers.tolist()], return_inverse=True)
    words, speed = types.tolist(), np.hypot(flat["vx"], flat["vy"])
    sizes = flat["length"], flat["width"]
    number_of_kind, notes = with_unknown_vehicles(words, given, track, *sizes, speed)
    kinds = [words[k] for k in number_of_kind]
    fill_sizes(flat, track, kinds)
    flat["timestamp_ms"] = np.asarray(1000.0 * frame / rate_hz, np.float64)
    motor = np.array([name in MOTOR_TYPES for name in kinds], bool)[track]
    labels, step_s = [str(number) for number in numbers], 1.0 / rate_hz
    return track_table(path, motor, track, labels, kinds, step_s=step_s, notes=notes, frame_id=frame, **flat)


def read_meta(path: Path) -> dict[str, str]:
    """Read the row of a ``recordingMeta.csv``."""
    rows = _read_rows(path)
    if not rows:
        raise TrackError(f"{path}: no row in it; take the file as published")
    return rows[0]


def _read_rows(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        raise TrackError(f"{path}: no such file; it belongs to the tracks beside it")
    with refusing_damage(TrackError, path, "table"), open_text(path) as file:
        rows = list(csv.DictReader(file))
    # A line cut short, or with too many values, has None for a value or a name.
    return [{name: row[name] or "" for name in row if name} for row in rows]


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        meta_path = levelx_file(path, "recordingMeta")
        try:
            meta = read_meta(meta_path)
        except TrackError:
            meta = {}  # reported when the recording is loaded
        map_path = meta_path if _LOWER in meta else _nearest_map(path, meta)
        name, site = recording_name(map_path, (path,)), place_name(map_path)
        yield Recording(name=name, site=site, dataset="levelx", map_path=map_path, track_paths=(path,))


def _nearest_map(path: Path, meta: dict[str, str]) -> Path:
    folders = [folder / "maps" for folder in (path.parent, path.parent.parent)]
    maps = sorted(x for folder in folders for end in ("osm", "osm.gz") for x in folder.rglob(f"*.{end}"))
    unknown = folders[-1] / f"location{meta.get('locationId', '')}.osm"
    place = number(meta.get("latLocation")), number(meta.get("lonLocation"))
    if not on_earth(*place):
        return maps[0] if len(maps) == 1 else unknown
    distances = {file: distance_m(_middle(file, file.stat().st_mtime_ns), place) for file in maps}
    return min(distances, key=lambda file: (distances[file], file), default=unknown)


@lru_cache(maxsize=64)
def _middle(map_path: Path, _changed_ns: int) -> Place:
    with suppress(MapError):
        return read_map_file(map_path).middle
    return 90.0, 0.0


def _origin(tracks_path: Path, map_path: Path) -> Place | None:
    """Place of a recording's UTM origin; the zone is that of its location, else of the map."""
    meta_path = levelx_file(tracks_path, "recordingMeta")
    meta = read_meta(meta_path)
    if not meta.get("xUtmOrigin") or not meta.get("yUtmOrigin"):
        return None
    origin = np.array([[number(meta["xUtmOrigin"]), number(meta["yUtmOrigin"])]])
    if "latLocation" in meta and "lonLocation" in meta:
        near = number(meta["latLocation"]), number(meta["lonLocation"])
    else:
        near = read_map_file(map_path).middle
    try:
        [place] = to_degrees(origin, near, absolute=True)
    except RuntimeError:
        place = np.full(2, math.nan)
    if not on_earth(*place) or distance_m(place, near) > LOCATION_M:
        got = f"{meta['xUtmOrigin']},{meta['yUtmOrigin']}"
        raise MapError(f"{meta_path}: xUtmOrigin, yUtmOrigin {got} is not near its location; repair the file")
    return float(place[0]), float(place[1])


def _highd(columns: dict[str, Any], of_track: dict[int, dict[str, str]], path: Path) -> dict[str, FloatArray]:
    vx, vy = columns["xVelocity"], -columns["yVelocity"]
    directions = {i: number(meta.get("drivingDirection")) for i, meta in of_track.items()}
    if not set(directions.values()) <= {1.0, 2.0}:
        raise TrackError(f"{levelx_file(path, 'tracksMeta')}: drivingDirection is not 1 or 2 everywhere")
    # 1: the upper lanes, to the left
    along = np.array([math.pi if directions.get(int(number)) == 1.0 else 0.0 for number in columns["id"]])
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


def _track_meta(path: Path, id_column: str) -> dict[int, dict[str, str]]:
    rows = _read_rows(path)
    for name in (id_column, "class"):
        if rows and name not in rows[0]:
            raise TrackError(f"{path}: no column {name}; take the file as published")
    by_id = {}
    for line, row in enumerate(rows, start=2):
        track = number(row[id_column])
        if not track.is_integer():
            raise TrackError(f"{path}: line {line}: {id_column} is {row[id_column]!r}, not an integer")
        by_id[int(track)] = row
    return by_id


def _read_columns(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    options: Any = arrow_csv.ConvertOptions(
        include_columns=list(names),
        column_types={name: pa.int64() if name in ("id", "trackId") else pa.float64() for name in names},
    )
    with refusing_damage(TrackError, path, "table"), open_binary(path) as file:
        arrow = arrow_csv.read_csv(in_arrow(file), convert_options=options)
    # An id stays an integer; one that is missing makes the column floats, and an error below.
    columns = {name: np.array(arrow[name].to_numpy()) for name in names}
    if not arrow.num_rows:
        raise TrackError(f"{path}: a header and no rows; give a file with tracks")
    refuse_values(path, columns, _MAX, lambda row: f"line {row + 2}")
    return columns


LEVELX = Dataset(is_mine=is_levelx, read=with_notes(read_levelx), recordings=_recordings, origin=_origin)


def _name(path: Path) -> str:
    return f"highd_{map_name(path).removesuffix(Path(LEVELX_META).stem)}"


def _tracks(path: Path) -> Path:
    tracks = path.with_name(unpacked_name(path).replace(LEVELX_META, LEVELX_TRACKS))
    return plain_or_packed(tracks) or tracks


def _read_road(path: Path, **_: object) -> Road:
    """Build lanes, with highD's own ``laneId``, from ``upperLaneMarkings`` and ``lowerLaneMarkings``."""
    with refusing_damage(MapError, path, "map of highD"):
        meta = read_meta(path)
    if _LOWER not in meta:
        raise MapError(f"{path}: no lane markings in it, so no road; give a Lanelet2 map (.osm)")
    upper, lower = (_markings(path, meta, name) for name in (_UPPER, _LOWER))
    limit = number(meta.get("speedLimit") or "-1")  # -1: none
    if math.isnan(limit):
        raise MapError(f"{path}: speedLimit is {meta['speedLimit']!r}; a number expected, in m/s")
    drawn = DrawnMap(path=path, moved=False)
    drawn.lanes += _carriageway(upper, first_id=2, leftwards=True, speed_mps=limit)
    drawn.lanes += _carriageway(lower, first_id=len(upper) + 2, leftwards=False, speed_mps=limit)
    road = drawn_road(drawn, name=_name(path), country=GERMANY)
    note = f"straight lanes by highD's markings, {BEYOND_M:g} m longer than filmed at both ends"
    return replace(road, notes=(*road.notes, note))


def _markings(path: Path, meta: dict[str, str], name: str) -> FloatArray:
    text = meta.get(name, "")
    values = np.array([number(marking) for marking in text.split(";") if marking.strip()])
    if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values) > 1.0).all():
        raise MapError(f"{path}: {name} is {text!r}; rising numbers more than 1 m apart expected")
    return values


def _carriageway(
    markings: FloatArray, *, first_id: int, leftwards: bool, speed_mps: float
) -> Iterator[DrawnLane]:
    x = np.linspace(-BEYOND_M, FILMED_M + BEYOND_M, round((FILMED_M + 2 * BEYOND_M) / _POINT_M) + 1)
    x = x[::-1] if leftwards else x
    for k, (top, bottom) in enumerate(pairwise(-markings), start=first_id):
        sides = [(top, k - 1), (bottom, k + 1)]
        # For a vehicle that drives to the left, left is downwards in the picture.
        (left, on_left), (right, on_right) = sides[::-1] if leftwards else sides
        middle, left_bound, right_bound = (
            np.stack((x, np.full(len(x), y)), axis=1) for y in ((top + bottom) / 2.0, left, right)
        )
        yield DrawnLane(
            name=k,
            centre=middle,
            left=left_bound,
            right=right_bound,
            subtype="highway",
            location="nonurban",
            limit_mps=speed_mps,
            successors=(),
            left_neighbours=[on_left],
            right_neighbours=[on_right],
        )


HIGHD = MapFormat(is_mine=is_highd_map, read=_read_road, tracks=_tracks, name=_name)
