"""Drawing of a road: polygons of an additional file for sumo-gui."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple
from xml.sax.saxutils import quoteattr as quoted

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import shape_text
from scex_sumo.geometry.polylines import cut, length_of
from scex_sumo.road import Marking, Road


class _Style(NamedTuple):
    color: str
    layer: int
    width: float = 0.12
    dash: float = 0.0


WHITE, GREY = "240,240,240", "130,130,130"
LINES = {
    "line_thin": _Style(WHITE, 5),
    "line_thick": _Style(WHITE, 5, 0.25),
    "stop_line": _Style(WHITE, 6, width=0.40),
    "pedestrian_marking": _Style(WHITE, 6, width=0.30, dash=0.5),
    "zebra_marking": _Style(WHITE, 6, width=0.30, dash=0.5),
    "bike_marking": _Style("200,80,60", 6, dash=0.5),
    "curbstone": _Style(GREY, 4, width=0.20),
    "road_border": _Style(GREY, 4, width=0.20),
    "guard_rail": _Style("90,90,110", 4, width=0.20),
    "fence": _Style("110,90,70", 4),
    "wall": _Style("90,80,70", 4, width=0.30),
}
OTHER_LINE = _Style("180,180,180", 4, width=0.10)
AREAS = {
    "crosswalk": _Style("235,235,200,140", 2),
    "walkway": _Style("170,165,155,200", -2),
    "shared_walkway": _Style("170,165,155,200", -2),
    "stairs": _Style("150,145,140,200", -2),
    "bikelane": _Style("190,110,90,180", -1),
    "bicycle_lane": _Style("190,110,90,180", -1),
    "keepout": _Style("210,120,100,120", 1),
    "parking": _Style("120,140,180,160", -1),
    "traffic_island": _Style("120,150,110,220", 3),
    "vegetation": _Style("110,150,100,220", -3),
    "building": _Style("140,120,110,220", -3),
}
OTHER_AREA = _Style("150,160,140,150", -3)
DASH_M = 3.0


def extras_text(road: Road) -> str:
    """Return the text of the additional file; ids are ``area.N``, ``marking.N``, ``stop_line.N``."""
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "", "<additional>"]
    for n, area in enumerate(road.areas):
        lines.append(_poly(f"area.{n}", area.kind, AREAS.get(area.kind, OTHER_AREA), area.outline, fill=True))
    styled = ((marking, LINES.get(marking.kind, OTHER_LINE)) for marking in road.markings)
    strokes = ((marking.kind, style, line) for marking, style in styled for line in _strokes(marking, style))
    lines += [_poly(f"marking.{n}", *stroke) for n, stroke in enumerate(strokes)]
    # 0.0 for -0.0
    drawn = {(marking.points + 0.0).tobytes() for marking in road.markings if marking.kind == "stop_line"}
    stops = {(line + 0.0).tobytes(): line for rule in road.regulations for line in rule.stop_lines}
    unmarked = (line for content, line in stops.items() if content not in drawn)
    lines += [_poly(f"stop_line.{n}", "stop_line", LINES["stop_line"], x) for n, x in enumerate(unmarked)]
    return "\n".join([*lines, "</additional>", ""])


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
