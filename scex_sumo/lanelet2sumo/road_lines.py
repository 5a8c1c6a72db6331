"""Road lines to draw, from a net and its markings."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import net_file
from scex_sumo.converters.net.text import points_of
from scex_sumo.lanelet2sumo.reader import read_net

_BORDERS = {"curbstone", "road_border", "guard_rail", "fence", "wall"}

SURFACE, AREA, MARKING, BORDER, STOP = range(5)
"""How a line of the road is drawn; surfaces are as wide as said, areas are filled."""


class RoadLine(NamedTuple):
    """Line of a road: points (P, 2) in m, and the width of a surface, else 0."""

    kind: int
    width_m: float
    points: FloatArray


def road_lines(net: Path, box: tuple[float, float, float, float]) -> list[RoadLine]:
    """Return the road lines that touch a box; none of a missing file.

    Args:
        net: NET.net.xml, with NET.add.xml beside it.
        box: least and largest x, least and largest y, m.
    """
    lines = []
    if net.is_file():
        content = read_net(net)
        lines += [RoadLine(SURFACE, lane.width_m, lane.shape) for lane in content.lanes.values()]
        lines += [RoadLine(AREA, 0.0, junction.shape) for junction in content.junctions.values()]
    extras = net_file(net, ".add.xml")
    if extras.is_file():
        for poly in ElementTree.parse(extras).getroot().iter("poly"):
            kind = poly.get("type", "")
            if poly.get("fill") == "0":
                style = BORDER if kind in _BORDERS else STOP if kind == "stop_line" else MARKING
                lines.append(RoadLine(style, 0.0, points_of(poly.get("shape", ""))))
    return [line for line in lines if len(line.points) > 1 and _touches(line.points, box)]


def _touches(points: FloatArray, box: tuple[float, float, float, float]) -> bool:
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(low[0] <= box[1] and high[0] >= box[0] and low[1] <= box[3] and high[1] >= box[2])
