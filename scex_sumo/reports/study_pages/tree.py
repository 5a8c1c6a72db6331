"""Tree of runs beside the matrix of their distances, as SVG."""

from __future__ import annotations

from math import sqrt

from scex_sumo.reports.page.html import Html, element
from scex_sumo.statistics.grouping import Grouping
from scex_sumo.studies.compare import Comparison

_TREE_PX, _ROW_PX, _LETTER_PX, _GAP_PX = 170, 24, 7.4, 8
_NUMBERS_UP_TO = 20
"""Runs whose distances are written into the matrix."""
_COLORS = 6


def draw_tree(comparison: Comparison, grouping: Grouping, noise: float) -> Html:
    """Leaves in the middle beside their names, the matrix at the right, in the same rows.

    Args:
        comparison: distances of the runs.
        grouping: the tree, its groups and its order.
        noise: distance that chance alone makes; shaded in the tree.
    """
    order = [int(run) for run in grouping.order]
    wide = _LETTER_PX * max(len(name) for name in comparison.labels) + 2 * _GAP_PX
    left, height = _TREE_PX + wide, _ROW_PX * len(order)
    parts = [*_branches(grouping, noise, height)]
    for row, run in enumerate(order):
        color = f"c{(int(grouping.group[run]) - 1) % _COLORS}"
        y = _ROW_PX * row + 16
        parts.append(element(f"text.leaf.{color}", comparison.labels[run], x=_TREE_PX + _GAP_PX, y=y))
        parts += _row(comparison, order, run, row, left)
    whole = f"0 0 {left + _ROW_PX * 1.6 * len(order):.0f} {height + 4}"
    width = int(left + _ROW_PX * 1.6 * len(order))
    drawing = element("svg", *parts, viewBox=whole, width=width, height=height + 4, role="img")
    return element("div.scroll", drawing)


def _row(comparison: Comparison, order: list[int], run: int, row: int, left: float) -> list[Html]:
    """Distances of a run to all, as cells."""
    total, most = comparison.total, max(float(comparison.total.max()), 1e-9)
    found = []
    for column, other in enumerate(order):
        value, x = float(total[run, other]), left + 1.6 * _ROW_PX * column
        ink = f"{value / most:.2f}"
        size: dict[str, str | int] = {"width": f"{1.6 * _ROW_PX - 1:.1f}", "height": _ROW_PX - 1}
        found.append(element("rect.cell", x=f"{x:.1f}", y=_ROW_PX * row, fill_opacity=ink, **size))
        if run != other and len(order) <= _NUMBERS_UP_TO:
            kind = "text.light" if value > 0.6 * most else "text.dark"
            place: dict[str, str | int] = {"x": f"{x + 0.8 * _ROW_PX:.1f}", "y": _ROW_PX * row + 16}
            found.append(element(kind, f"{value:.2f}", text_anchor="middle", **place))
    return found


def _branches(grouping: Grouping, noise: float, height: int) -> list[Html]:
    """The tree; its axis is the root of the distance, so that small groups have room."""
    count = len(grouping.order)
    top = max(float(grouping.linkage[-1, 2]), noise if noise == noise else 0.0, 1e-9)

    def x_of(distance: float) -> float:
        return _TREE_PX * (1 - 0.97 * sqrt(max(distance, 0.0) / top))

    place = {int(run): _ROW_PX * (row + 0.5) for row, run in enumerate(grouping.order)}
    depth = dict.fromkeys(place, 0.0)
    group: dict[int, int] = {run: int(grouping.group[run]) for run in place}
    found = []
    if noise == noise and noise > 0:
        x = x_of(noise)
        box: dict[str, str | int] = {"x": f"{x:.1f}", "width": f"{_TREE_PX - x:.1f}", "height": height}
        found.append(element("rect.chance", element("title", "by chance"), y=0, **box))
    for step, (one, two, at, _) in enumerate(grouping.linkage):
        parts, joined = (int(one), int(two)), count + step
        same = group[parts[0]] if group[parts[0]] == group[parts[1]] else 0
        color = f"c{(same - 1) % _COLORS}" if same else "soft"
        (x, low), (right, high) = (
            (x_of(depth[parts[0]]), place[parts[0]]),
            (x_of(depth[parts[1]]), place[parts[1]]),
        )
        middle = x_of(float(at))
        found.append(
            element(f"path.line.{color}", d=f"M{x:.1f},{low:.1f}H{middle:.1f}V{high:.1f}H{right:.1f}")
        )
        place[joined], depth[joined], group[joined] = (low + high) / 2, float(at), same
    return found
