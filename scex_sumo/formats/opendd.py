"""openDD: recordings of roundabouts, the tables of ``trajectories_rdbN_v3.sqlite``, and ``map_rdbN.sqlite``.

A recording is named FILE/TABLE, e.g. ``trajectories_rdb1_v3.sqlite/rdb1_4``; FILE alone is its first table.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.lanelet.tags import GERMANY
from scex_sumo.converters.registries import Dataset, MapFormat, Recording, with_notes
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road
from scex_sumo.formats.recognition import is_opendd, is_opendd_map
from scex_sumo.formats.samples.boxes import box_table
from scex_sumo.road import Road

UTM32 = "+proj=utm +zone=32 +datum=WGS84 +units=m +no_defs"
_COLUMNS = ("OBJID", "CLASS", "TIMESTAMP", "UTM_X", "UTM_Y", "V", "UTM_ANGLE", "LENGTH", "WIDTH")
_KINDS = {"medium vehicle": "car", "heavy vehicle": "truck"}
_TABLE = re.compile(r"rdb\w*")


def _opened(path: Path) -> closing[sqlite3.Connection]:
    return closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True))


def _rows(path: Path, table: str, columns: Sequence[str]) -> list[tuple[Any, ...]]:
    with _opened(path) as file:
        file.execute("PRAGMA trusted_schema = OFF")
        known = {row[1] for row in file.execute(f'PRAGMA table_info("{table}")')}
        if missing := [name for name in columns if name not in known]:
            raise KeyError(f"column {missing[0]} in table {table}" if known else f"table {table}")
        return file.execute(f'SELECT {", ".join(columns)} FROM "{table}"').fetchall()


def _tables(path: Path) -> list[str]:
    try:
        with _opened(path) as file:
            rows = file.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    except sqlite3.Error:
        return []  # reported when the recording is read
    number = re.compile(r"\d+")
    names = [str(name) for (name,) in rows if _TABLE.fullmatch(str(name))]
    return sorted(names, key=lambda name: ([int(n) for n in number.findall(name)], name))


def _drawn(path: Path) -> DrawnMap:
    drawn = DrawnMap(path=path)
    for name, kind, geometry, successors in _rows(
        path, _name(path), ("id", "type", "geometry", "successors")
    ):
        if kind == "trafficLane":
            line = shapely.get_coordinates(shapely.from_wkt(geometry))
            after = [int(float(word)) for word in re.findall(r"[\d.]+", successors or "")]
            drawn.lanes.append(DrawnLane(name=int(name), centre=line, successors=after))
        elif kind == "boundary" and geometry:
            drawn.lines.append(("road_border", "", shapely.get_coordinates(shapely.from_wkt(geometry))))
    return drawn


def _read_road(path: Path, **_: Any) -> Road:
    with refusing_damage(MapError, path, "map of openDD"):
        return drawn_road(_drawn(path), name=_name(path), country=GERMANY, projection=UTM32)


def _read(path: Path) -> TrackTable:
    with refusing_damage(TrackError, path, "recording of openDD"):
        rows = _rows(path.parent, path.name, _COLUMNS)
        names = [str(row[0]) for row in rows]
        words = [str(row[1]).lower() for row in rows]
        kinds = {name: _KINDS.get(word, word) for name, word in zip(names, words, strict=True)}
        numbers = [[np.nan if value is None else value for value in row[2:]] for row in rows]
        time, x, y, speed, angle, length, width = np.array(numbers, np.float64).reshape(-1, 7).T
        east, north = _drawn(_map_of(path)).frame
        v = (speed * np.cos(angle), speed * np.sin(angle))
        values = np.stack([1000.0 * time, x - east, y - north, *v, angle, length, width], axis=1)
        return box_table(path, names, kinds, values)


def _map_of(path: Path) -> Path:
    place = path.name.split("_")[0]
    file = Path(f"map_{place}", f"map_{place}.sqlite")
    above = path.parent.parent
    places = [folder / end for folder in (above, above.parent) for end in (file, Path(place) / file)]
    return next((candidate for candidate in places if candidate.is_file()), places[0])


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    of_tables = ([path / t for t in _tables(path)] if path.suffix == ".sqlite" else [path] for path in files)
    for path in chain.from_iterable(of_tables):
        map_path = _map_of(path)
        yield Recording(
            name=path.name, site=_name(map_path), dataset="opendd", map_path=map_path, track_paths=(path,)
        )


def _tracks(path: Path) -> Path | None:
    folders = (path.parent, *path.parents[1:4])
    name = f"trajectories_{_name(path)}_v3.sqlite"
    return next((folder / name for folder in folders if (folder / name).is_file()), None)


def _name(path: Path) -> str:
    return path.stem.removeprefix("map_")


OPENDD_MAP = MapFormat(
    is_mine=is_opendd_map,
    read=_read_road,
    tracks=_tracks,
    name=_name,
    asks_for="--tracks trajectories_rdbN_v3.sqlite/TABLE",
)
OPENDD = Dataset(
    is_mine=is_opendd,
    read=with_notes(_read),
    recordings=_recordings,
    files=lambda path: (path / next(iter(_tables(path)), "rdb") if path.suffix == ".sqlite" else path,),
    name=lambda path, files: files[0].name,
)
