"""OpenSCENARIO scenarios as maps and recordings, and the CSV logs that esmini writes of them."""

from __future__ import annotations

import csv
import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.base.progress import Progress
from scex_sumo.converters.naming import map_name, open_binary
from scex_sumo.converters.registries import Dataset, MapFormat, Recording, Window
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.converters.xml import unpacked, xml_root
from scex_sumo.formats.opendrive.lanes import opendrive_map
from scex_sumo.formats.opendrive.reader import read_opendrive
from scex_sumo.formats.openscenario.document import Entity, map_of, read_document
from scex_sumo.formats.openscenario.motion import TICK_S
from scex_sumo.formats.openscenario.places import Places, Pose, UnknownMotion
from scex_sumo.formats.openscenario.story import Storyboard
from scex_sumo.formats.recognition import is_esmini_log, is_openscenario
from scex_sumo.formats.samples.boxes import MAX_ITEMS, box_table, one_line
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

MAX_S, AFTER_S = 600.0, 10.0  # of a scenario without an end, and after the last story
_EVERY = 5  # ticks between two samples
_WHAT = "scenario of OpenSCENARIO"
_PLACE = ("World_Position_X [m]", "World_Position_Y [m]", "World_Heading_Angle [rad]", "Current_Speed [m/s]")
_BOX = ("bb_x [m]", "bb_y [m]", "bb_length [m]", "bb_width [m]")
_WALKER_M = 1.2  # a box that is longer is that of a vehicle


def _map_of(path: Path) -> Path:
    with one_line(MapError, path, _WHAT):
        return map_of(path)


def _read_road(path: Path, **options: Any) -> Road:
    return read_opendrive(_map_of(path), **options)


def _read(
    paths: Sequence[Path],
    *,
    net: Path | None = None,
    window: Window = (None, None),
    progress: Progress | None = None,
) -> tuple[TrackTable, tuple[str, ...]]:
    """Drive a scenario's own actions; samples every 0.1 s, until it is not known any more."""
    path, map_path, end_s = paths[0], _map_of(paths[0]), min(MAX_S, window[1] or MAX_S)
    labels: list[str] = []
    values: list[tuple[float, ...]] = []
    with one_line(TrackError, path, _WHAT):
        root, entities = read_document(path)
        numbers = _numbers(entities)
        drawn = opendrive_map(map_path, xml_root(map_path, remedy="export the map again"))
        story, notes = Storyboard(root, entities, Places(drawn)), []
        for tick in itertools.count():
            time_s = tick * TICK_S
            there = [(numbers[name], mover) for name, mover in story.movers.items() if mover.there]
            for label, mover in there if tick % _EVERY == 0 else ():
                labels.append(label)
                values.append(
                    _sample(time_s, mover.centre, mover.entity.length, mover.entity.width, mover.speed)
                )
            if not there or time_s > min(end_s, story.over_s + AFTER_S) or len(values) > MAX_ITEMS // 8:
                break
            try:
                if not story.step(time_s):
                    break
            except UnknownMotion as why:
                notes.append(f"the scenario is known until {math.floor(10 * time_s) / 10:g} s: {why}")
                break
        kinds = {numbers[name]: entity.kind for name, entity in entities.items()}
        table, more = box_table(path, labels, kinds, np.array(values).reshape(-1, 8))
        table = replace(table, complete=partial(_completed, {label: name for name, label in numbers.items()}))
        return table, (*notes, *more)


def _numbers(entities: Mapping[str, Entity]) -> dict[str, str]:
    """Return a label for each entity: of vehicles the numbers in their names if all differ, else new ones."""
    vehicles = [name for name, entity in entities.items() if entity.kind in MOTOR_TYPES]
    own = [(re.findall(r"[0-9]{1,9}$", name) or [""])[0].lstrip("0") for name in vehicles]
    if "" in own or len({*own}) < len(own):
        own = [str(k) for k in range(1, len(own) + 1)]
    return {**{name: name for name in entities}, **dict(zip(vehicles, own, strict=True))}


def _completed(names: Mapping[str, str], scene: SeedScene) -> SeedScene:
    vehicles = {str(track): names.get(str(track), str(track)) for track in scene.track_ids}
    vehicles = {} if all(name.endswith(track) for track, name in vehicles.items()) else vehicles
    return replace(scene, source={"kind": "scenario", "vehicles": vehicles})


def _sample(time_s: float, centre: Pose, length: float, width: float, speed: float) -> tuple[float, ...]:
    vx, vy = speed * math.cos(centre.heading), speed * math.sin(centre.heading)
    return 1000.0 * time_s, centre.x, centre.y, vx, vy, centre.heading, length, width


def _read_log(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    """Read a log of esmini: one row for each time, with the columns of entity k after ``#k``."""
    path = paths[0]
    names: list[str] = []
    values: list[tuple[float, ...]] = []
    with one_line(TrackError, path, "log of esmini"), open_binary(path) as file:
        lines = iter(file.read().decode("utf-8").splitlines())
        head = next((line for line in lines if "TimeStamp [s]" in line), "").split(",")
        column = {name.strip(): k for k, name in enumerate(head)}
        entities = itertools.takewhile(lambda k: f"#{k} {_PLACE[0]}" in column, itertools.count(1))
        columns = [
            [column[f"#{k} {name}"] for name in ("Entitity_Name [-]", *_PLACE, *_BOX)] for k in entities
        ]
        for row in csv.reader(lines):
            for name, *numbers in columns if len(row) >= len(head) - 1 else ():
                x, y, heading, speed, ahead, left, length, width = (float(row[k]) for k in numbers)
                names.append(row[name].strip())
                centre = Pose(x=x, y=y, heading=heading).moved(ahead, left)
                values.append(_sample(float(row[column["TimeStamp [s]"]]), centre, length, width, speed))
        lengths = {name: row[6] for name, row in zip(names, values, strict=True)}
        kinds = {name: "car" if length > _WALKER_M else "pedestrian" for name, length in lengths.items()}
        return box_table(path, names, kinds, np.array(values).reshape(-1, 8))


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        site = map_name(_map_of(path))
        yield Recording(
            name=map_name(path), site=site, dataset="openscenario", map_path=path, track_paths=(path,)
        )


OPENSCENARIO_MAP = MapFormat(
    is_mine=is_openscenario,
    read=_read_road,
    tracks=lambda path: path,
    asks_for="--tracks LOG.csv",
    opendrive=lambda path: unpacked(_map_of(path)),
)
OPENSCENARIO = Dataset(
    is_mine=is_openscenario, read=_read, recordings=_recordings, within=within_map, simulated=True
)
ESMINI = Dataset(is_mine=is_esmini_log, read=_read_log, within=within_map)
