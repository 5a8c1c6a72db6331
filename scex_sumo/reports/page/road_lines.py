"""Road of a page: its lines as SVG writes paths."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.page.packing import quantized
from scex_sumo.views.road_lines import AREA, RoadLine

UNIT_M = 0.05


def road_paths(lines: Iterable[RoadLine]) -> list[dict[str, Any]]:
    """Lines of a road, those first that others are drawn upon.

    Returns:
        ``kind``, ``width`` in m, and ``path`` as SVG writes it, in units of 5 cm; all lines of one kind and
        width together, each area by itself.
    """
    groups: dict[tuple[int, float, int], list[str]] = {}
    for number, (kind, width, points) in enumerate(lines):
        groups.setdefault((kind, width, number if kind == AREA else -1), []).append(_path(points))
    order = sorted(groups.items(), key=lambda item: item[0])
    return [{"kind": kind, "width": width, "path": "".join(paths)} for (kind, width, _), paths in order]


def _path(points: FloatArray) -> str:
    """A line as SVG writes it: from a point in small steps."""
    whole = quantized(points, UNIT_M)
    first, steps = whole[0], np.diff(whole, axis=0)
    return f"M{first[0]} {first[1]}l" + " ".join(f"{x} {y}" for x, y in steps.tolist())
