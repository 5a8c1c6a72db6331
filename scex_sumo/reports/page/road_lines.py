"""Road of a page: surfaces and markings around the vehicles, from the files that sumo-gui draws."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.page.packing import quantized

UNIT_M = 0.05
_LANE = re.compile(r"<lane [^>]*?\bwidth=\"([\d.]+)\"[^>]*?\bshape=\"([^\"]+)\"")
_JUNCTION = re.compile(r"<junction [^>]*?\bshape=\"([^\"]+)\"")
_POLYGON = re.compile(r"<poly [^>]*?\btype=\"([^\"]*)\"[^>]*?\bfill=\"(\d)\"[^>]*?\bshape=\"([^\"]+)\"")
_BORDERS = {"curbstone", "road_border", "guard_rail", "fence", "wall"}

SURFACE, AREA, MARKING, BORDER, STOP = range(5)
"""How a line of the road is drawn; surfaces are as wide as said, areas are filled."""


def road_paths(net: Path, box: tuple[float, float, float, float]) -> list[dict[str, Any]]:
    """Lines of the road within a box, those first that others are drawn upon.

    Args:
        net: NET.net.xml, with NET.add.xml beside it.
        box: least and largest x, least and largest y, m.

    Returns:
        ``kind``, ``width`` in m, and ``path`` as SVG writes it, in units of 5 cm; all lines of one kind and
        width together, each area by itself.
    """
    groups: dict[tuple[int, float, int], list[str]] = {}
    for number, (kind, width, points) in enumerate(_lines(net)):
        if _touches(points, box):
            groups.setdefault((kind, width, number if kind == AREA else -1), []).append(_path(points))
    order = sorted(groups.items(), key=lambda item: item[0])
    return [{"kind": kind, "width": width, "path": "".join(paths)} for (kind, width, _), paths in order]


def _path(points: FloatArray) -> str:
    """A line as SVG writes it: from a point in small steps."""
    whole = quantized(points, UNIT_M)
    first, steps = whole[0], np.diff(whole, axis=0)
    return f"M{first[0]} {first[1]}l" + " ".join(f"{x} {y}" for x, y in steps.tolist())


def _lines(net: Path) -> list[tuple[int, float, FloatArray]]:
    """Kind, width in m and points of everything there is to draw; none of what is not there."""
    text = net.read_text(encoding="utf-8") if net.is_file() else ""
    lines = [(SURFACE, float(width), _points(shape)) for width, shape in _LANE.findall(text)]
    lines += [(AREA, 0.0, _points(shape)) for shape in _JUNCTION.findall(text)]
    extras = net.with_name(net.name.removesuffix(".net.xml") + ".add.xml")
    drawn = extras.read_text(encoding="utf-8") if extras.is_file() else ""
    for kind, filled, shape in _POLYGON.findall(drawn):
        if filled == "0":
            style = BORDER if kind in _BORDERS else STOP if kind == "stop_line" else MARKING
            lines.append((style, 0.0, _points(shape)))
    return [line for line in lines if len(line[2]) > 1]


def _points(shape: str) -> FloatArray:
    flat = np.array(shape.replace(",", " ").split(), dtype=np.float64)
    count = len(shape.split())
    return flat.reshape(count, -1)[:, :2]


def _touches(points: FloatArray, box: tuple[float, float, float, float]) -> bool:
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(low[0] <= box[1] and high[0] >= box[0] and low[1] <= box[3] and high[1] >= box[2])
