"""Road of a page: surfaces and markings around the vehicles, from the files that sumo-gui draws."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.page.packing import quantized

UNIT_M = 0.05
_LANE = re.compile(r"<lane [^>]*?\bwidth=\"([\d.]+)\"[^>]*?\bshape=\"([^\"]+)\"")
_JUNCTION = re.compile(r"<junction [^>]*?\bshape=\"([^\"]+)\"")
_POLYGON = re.compile(r"<poly [^>]*?\btype=\"([^\"]*)\"[^>]*?\bfill=\"(\d)\"[^>]*?\bshape=\"([^\"]+)\"")
_BORDERS = {"curbstone", "road_border", "guard_rail", "fence", "wall"}

SURFACE, MARKING, BORDER, AREA, STOP = range(5)
"""How a line of the road is drawn; surfaces are as wide as said, areas are filled."""


def road_arrays(net: Path, box: tuple[float, float, float, float]) -> dict[str, NDArray[Any]]:
    """Lines of the road within a box.

    Args:
        net: NET.net.xml, with NET.add.xml beside it.
        box: least and largest x, least and largest y, m.

    Returns:
        ``road_points`` (P, 2) first differences within each line, ``road_sizes`` (L,) their numbers of
        points, ``road_kinds`` (L,) and ``road_widths`` (L,) in units of 5 cm.
    """
    found = _lines(net)
    kept = [(kind, width, points) for kind, width, points in found if _touches(points, box)]
    whole = [quantized(points, UNIT_M) for _, _, points in kept]
    steps = [np.diff(points, axis=0, prepend=0) for points in whole]
    return {
        "road_points": np.concatenate(steps) if steps else np.zeros((0, 2), dtype=np.int64),
        "road_sizes": np.array([len(points) for points in whole], dtype=np.int64),
        "road_kinds": np.array([kind for kind, _, _ in kept], dtype=np.int64),
        "road_widths": quantized(np.array([width for _, width, _ in kept], dtype=float), UNIT_M),
    }


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
