"""Lines of a road to be drawn, from the net and the markings that sumo-gui draws."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scex_sumo.arrays import FloatArray

_LANE = re.compile(r"<lane [^>]*?\bwidth=\"([\d.]+)\"[^>]*?\bshape=\"([^\"]+)\"")
_JUNCTION = re.compile(r"<junction [^>]*?\bshape=\"([^\"]+)\"")
_POLYGON = re.compile(r"<poly [^>]*?\btype=\"([^\"]*)\"[^>]*?\bfill=\"(\d)\"[^>]*?\bshape=\"([^\"]+)\"")
_BORDERS = {"curbstone", "road_border", "guard_rail", "fence", "wall"}

SURFACE, AREA, MARKING, BORDER, STOP = range(5)
"""How a line of the road is drawn; surfaces are as wide as said, areas are filled."""


class RoadLine(NamedTuple):
    """A line of the road.

    Attributes:
        kind: how it is drawn.
        width_m: of a surface, else 0.
        points: (P, 2) m.
    """

    kind: int
    width_m: float
    points: FloatArray


def road_lines(net: Path, box: tuple[float, float, float, float]) -> list[RoadLine]:
    """Everything of a road that there is to draw; nothing of a file that is not there.

    Args:
        net: NET.net.xml, with NET.add.xml beside it.
        box: least and largest x, least and largest y, m, that lines must touch.
    """
    text = net.read_text(encoding="utf-8") if net.is_file() else ""
    lines = [RoadLine(SURFACE, float(width), _points(shape)) for width, shape in _LANE.findall(text)]
    lines += [RoadLine(AREA, 0.0, _points(shape)) for shape in _JUNCTION.findall(text)]
    extras = net.with_name(net.name.removesuffix(".net.xml") + ".add.xml")
    drawn = extras.read_text(encoding="utf-8") if extras.is_file() else ""
    for kind, filled, shape in _POLYGON.findall(drawn):
        if filled == "0":
            style = BORDER if kind in _BORDERS else STOP if kind == "stop_line" else MARKING
            lines.append(RoadLine(style, 0.0, _points(shape)))
    return [line for line in lines if len(line.points) > 1 and _touches(line.points, box)]


def _points(shape: str) -> FloatArray:
    flat = np.array(shape.replace(",", " ").split(), dtype=np.float64)
    count = len(shape.split())
    return flat.reshape(count, -1)[:, :2]


def _touches(points: FloatArray, box: tuple[float, float, float, float]) -> bool:
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(low[0] <= box[1] and high[0] >= box[0] and low[1] <= box[3] and high[1] >= box[2])
