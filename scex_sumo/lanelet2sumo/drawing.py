"""Drawing of a road: polygons of an additional file for sumo-gui, and the lines of a net and such a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr as quoted

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import net_file
from scex_sumo.converters.net.text import points_of, shape_text
from scex_sumo.geometry.polylines import cut, length_of
from scex_sumo.lanelet2sumo.reader import read_net
from scex_sumo.road import Marking, Road


@dataclass(frozen=True, kw_only=True)
class _Style:
    color: str
    layer: int
    width: float = 0.12
    dash: float = 0.0


WHITE, GREY = "240,240,240", "130,130,130"
LINES = {
    "line_thin": _Style(color=WHITE, layer=5),
    "line_thick": _Style(color=WHITE, layer=5, width=0.25),
    "stop_line": _Style(color=WHITE, layer=6, width=0.40),
    "pedestrian_marking": _Style(color=WHITE, layer=6, width=0.30, dash=0.5),
    "zebra_marking": _Style(color=WHITE, layer=6, width=0.30, dash=0.5),
    "bike_marking": _Style(color="200,80,60", layer=6, dash=0.5),
    "curbstone": _Style(color=GREY, layer=4, width=0.20),
    "road_border": _Style(color=GREY, layer=4, width=0.20),
    "guard_rail": _Style(color="90,90,110", layer=4, width=0.20),
    "fence": _Style(color="110,90,70", layer=4),
    "wall": _Style(color="90,80,70", layer=4, width=0.30),
}
OTHER_LINE = _Style(color="180,180,180", layer=4, width=0.10)
AREAS = {
    "crosswalk": _Style(color="235,235,200,140", layer=2),
    "walkway": _Style(color="170,165,155,200", layer=-2),
    "shared_walkway": _Style(color="170,165,155,200", layer=-2),
    "stairs": _Style(color="150,145,140,200", layer=-2),
    "bikelane": _Style(color="190,110,90,180", layer=-1),
    "bicycle_lane": _Style(color="190,110,90,180", layer=-1),
    "keepout": _Style(color="210,120,100,120", layer=1),
    "parking": _Style(color="120,140,180,160", layer=-1),
    "traffic_island": _Style(color="120,150,110,220", layer=3),
    "vegetation": _Style(color="110,150,100,220", layer=-3),
    "building": _Style(color="140,120,110,220", layer=-3),
}
OTHER_AREA = _Style(color="150,160,140,150", layer=-3)
DASH_M = 3.0


def extras_text(road: Road) -> str:
    """Return the text of the additional file; ids are ``area.N``, ``marking.N``, ``stop_line.N``."""
    head = ['<?xml version="1.0" encoding="UTF-8"?>', "", "<additional>"]
    return "\n".join([*head, *_areas(road), *_markings(road), *_stop_lines(road), "</additional>", ""])


def _areas(road: Road) -> Iterator[str]:
    for number, area in enumerate(road.areas):
        yield _poly(f"area.{number}", area.kind, AREAS.get(area.kind, OTHER_AREA), area.outline, fill=True)


def _markings(road: Road) -> Iterator[str]:
    styled = ((marking, LINES.get(marking.kind, OTHER_LINE)) for marking in road.markings)
    strokes = ((marking, style, line) for marking, style in styled for line in _strokes(marking, style))
    for number, (marking, style, line) in enumerate(strokes):
        yield _poly(f"marking.{number}", marking.kind, style, line)


def _stop_lines(road: Road) -> Iterator[str]:
    drawn = {_content(marking.points) for marking in road.markings if marking.kind == "stop_line"}
    marked = len(drawn)
    for line in (line for rule in road.regulations for line in rule.stop_lines):
        if _content(line) not in drawn:
            yield _poly(f"stop_line.{len(drawn) - marked}", "stop_line", LINES["stop_line"], line)
            drawn.add(_content(line))


def _content(line: FloatArray) -> bytes:
    return (line + 0.0).tobytes()  # 0.0 for -0.0


def _strokes(marking: Marking, style: _Style) -> Iterator[FloatArray]:
    dash = style.dash or (DASH_M if "dashed" in marking.subtype else 0.0)
    total = length_of(marking.points)
    if dash == 0.0 or total <= dash:
        yield marking.points
        return
    # An odd number of equal strokes and gaps, so that the line begins and ends with a stroke.
    count = max(1, round(total / dash)) | 1
    for k in range(0, count, 2):
        yield cut(marking.points, k * total / count, (k + 1) * total / count)


def _poly(name: str, kind: str, style: _Style, line: FloatArray, *, fill: bool = False) -> str:
    look = f'color="{style.color}" fill="{fill:d}" layer="{style.layer}"'
    look += "" if fill else f' lineWidth="{style.width:.2f}"'
    return f'    <poly id="{name}" type={quoted(kind)} {look} shape="{shape_text(line)}"/>'


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
