"""CSV logs that esmini writes of the scenarios it plays."""

from __future__ import annotations

import csv
import itertools
import math
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.naming import open_binary
from scex_sumo.converters.registries import Dataset, with_notes
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.recognition import is_esmini_log
from scex_sumo.formats.samples.boxes import box_table
from scex_sumo.formats.samples.from_car import within_map

_NAME, _X, _TIME = "Entitity_Name [-]", "World_Position_X [m]", "TimeStamp [s]"
_COLUMNS = (
    *(_X, "World_Position_Y [m]", "World_Heading_Angle [rad]", "Current_Speed [m/s]"),
    *("bb_x [m]", "bb_y [m]", "bb_length [m]", "bb_width [m]"),
)
_WALKER_M = 1.2  # a box that is longer is that of a vehicle


def _read(path: Path) -> TrackTable:
    """Read a log: one row for each time, with the columns of entity k after ``#k``."""
    names: list[str] = []
    values: list[tuple[float, ...]] = []
    with refusing_damage(TrackError, path, "log of esmini"), open_binary(path) as file:
        lines = iter(file.read().decode("utf-8").splitlines())
        head = next((line for line in lines if _TIME in line), "").split(",")
        column = {name.strip(): k for k, name in enumerate(head)}
        entities = itertools.takewhile(lambda k: f"#{k} {_X}" in column, itertools.count(1))
        columns = [[column[f"#{k} {name}"] for name in (_NAME, *_COLUMNS)] for k in entities]
        for row in csv.reader(lines):
            for name, *numbers in columns if len(row) >= len(head) - 1 else ():
                x, y, heading, speed, ahead, left, length, width = (float(row[k]) for k in numbers)
                c, s, time_ms = math.cos(heading), math.sin(heading), 1000.0 * float(row[column[_TIME]])
                centre = x + c * ahead - s * left, y + s * ahead + c * left
                names.append(row[name].strip())
                values.append((time_ms, *centre, speed * c, speed * s, heading, length, width))
        lengths = {name: box[6] for name, box in zip(names, values, strict=True)}
        kinds = {name: "car" if length > _WALKER_M else "pedestrian" for name, length in lengths.items()}
        return box_table(path, names, kinds, np.array(values).reshape(-1, 8))


ESMINI = Dataset(is_mine=is_esmini_log, read=with_notes(_read), within=within_map)
