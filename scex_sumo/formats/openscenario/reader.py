"""OpenSCENARIO scenarios (ASAM OpenSCENARIO XML 1.0 to 1.3) as maps and recordings."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.base.progress import Progress
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Dataset, MapFormat, Recording, Window
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.converters.xml import unpacked, xml_root
from scex_sumo.formats.opendrive.lanes import opendrive_map
from scex_sumo.formats.opendrive.reader import read_opendrive
from scex_sumo.formats.opendrive.ways import Places
from scex_sumo.formats.openscenario.document import read_document
from scex_sumo.formats.openscenario.motion import TICKS_PER_S, Mover, UnknownMotion
from scex_sumo.formats.openscenario.story import Storyboard
from scex_sumo.formats.recognition import is_openscenario
from scex_sumo.formats.samples.boxes import MAX_ITEMS, box_table, one_line
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene

MAX_S, AFTER_S = 600.0, 10.0  # of a scenario without an end, and after the last story
_EVERY = TICKS_PER_S // 10  # ticks between two samples
_WHAT = "scenario of OpenSCENARIO"


def _map_of(path: Path) -> Path:
    with one_line(MapError, path, _WHAT):
        file = read_document(path).find("RoadNetwork/LogicFile")
        name = "" if file is None else file.get("filepath", "")
        if not name.lower().endswith((".xodr", ".xodr.gz")):
            raise ValueError(f"its road network is {name[-60:]!r}, no OpenDRIVE file")
        return path.parent / name.replace("\\", "/")


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
    notes: list[str] = []
    with one_line(TrackError, path, _WHAT):
        drawn = opendrive_map(map_path, xml_root(map_path, remedy="export the map again"))
        story = Storyboard(read_document(path), Places(drawn))
        numbers = _numbers(story.movers.values())
        for tick in itertools.count():
            time_s = tick / TICKS_PER_S
            if tick % _EVERY == 0:
                there = [mover for mover in story.movers.values() if mover.there]
                if not there or time_s > min(end_s, story.over_s + AFTER_S) or len(values) > MAX_ITEMS // 8:
                    break
                labels += [numbers[mover.name] for mover in there]
                values += [(1000.0 * time_s, *mover.sample()) for mover in there]
            try:
                if not story.step(time_s):
                    break
            except UnknownMotion as why:
                notes.append(f"the scenario is known until {math.floor(10 * time_s) / 10:g} s: {why}")
                break
        kinds = {numbers[mover.name]: mover.kind for mover in story.movers.values()}
        table, more = box_table(path, labels, kinds, np.array(values).reshape(-1, 8))
        table = replace(table, complete=partial(_completed, {label: name for name, label in numbers.items()}))
        return table, (*notes, *more)


def _numbers(movers: Iterable[Mover]) -> dict[str, str]:
    """Return a label for each name: of vehicles the numbers in their names if all differ, else new ones."""
    names = [mover.name for mover in movers if mover.kind in MOTOR_TYPES]
    own = [(re.findall(r"[0-9]{1,9}$", name) or [""])[0].lstrip("0") for name in names]
    if "" in own or len({*own}) < len(own):
        own = [str(k) for k in range(1, len(own) + 1)]
    return {mover.name: mover.name for mover in movers} | dict(zip(names, own, strict=True))


def _completed(names: Mapping[str, str], scene: SeedScene) -> SeedScene:
    vehicles = {str(track): names.get(str(track), str(track)) for track in scene.track_ids}
    vehicles = {} if all(name.endswith(track) for track, name in vehicles.items()) else vehicles
    return replace(scene, source={"kind": "scenario", "vehicles": vehicles})


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        name, site = map_name(path), map_name(_map_of(path))
        yield Recording(name=name, site=site, dataset="openscenario", map_path=path, track_paths=(path,))


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
