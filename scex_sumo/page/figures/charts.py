"""SVG charts of a page: lines, dots, bars. ``assets/chart.js`` draws brushed charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.registry import Metric
from scex_sumo.page.figures.axes import ticks
from scex_sumo.page.html import Html, element

_TICKS_PX = 18


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Coordinate plane of a chart; arguments are in axis units, y upwards.

    ``x`` and ``y`` are the ranges of the axes; sizes are in px, without the ticks below. Kinds of lines are
    colours: drawn, likely, recorded, critical, picked, or soft.
    """

    x: tuple[float, float]
    y: tuple[float, float] = (0.0, 1.0)
    width: int = 260
    height: int = 110

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return a point in px, clamped to the chart."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        upwards = (y - self.y[0]) / (self.y[1] - self.y[0])
        px, py = min(max(across, 0.0), 1.0) * self.width, (1 - min(max(upwards, 0.0), 1.0)) * self.height
        return round(px, 1), round(py, 1)

    def line(self, x: FloatArray, y: FloatArray, kind: str, *, dashed: bool = False) -> Html:
        """Return a polyline."""
        return element(f"path.line.{kind}{'.dashed' if dashed else ''}", d=self._path(x, y))

    def dot(self, x: float, y: float, kind: str, *, radius: float = 3.0, title: str = "") -> Html:
        """Return a dot with a tooltip."""
        px, py = self.at(x, y)
        words = [element("title", title)] if title else []
        return element(f"circle.dot.{kind}", *words, cx=f"{px}", cy=f"{py}", r=f"{radius:.1f}")

    def box(self, x: tuple[float, float], y: tuple[float, float], kind: str) -> Html:
        """Return a filled rectangle."""
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        return element(f"path.area.{kind}", d=self._path(*map(np.array, zip(*corners, strict=True))))

    def words(self, x: float, y: float, text: str, *, anchor: str = "middle") -> Html:
        """Return a text at a point."""
        px, py = self.at(x, y)
        return element("text.soft", text, x=f"{px}", y=f"{py}", text_anchor=anchor)

    def _path(self, x: FloatArray, y: FloatArray) -> str:
        points = [self.at(float(px), float(py)) for px, py in zip(x, y, strict=True)]
        return "M" + " ".join(f"{px:g},{py:g}" for px, py in points)

    def figure(self, title: str, *parts: Html, marks: Sequence[tuple[float, str]] | None = None) -> Html:
        """Return the chart with title and axis; ticks at ``marks`` with texts, None: at round numbers."""
        axis = [element("path.line.axis", d=f"M0,{self.height} {self.width},{self.height}")]
        for value, text in ticks(*self.x) if marks is None else marks:
            px = min(max(self.at(value, 0)[0], 10), self.width - 10)
            axis.append(element("text", text, x=f"{px:g}", y=f"{self.height + 14}", text_anchor="middle"))
        whole = f"0 0 {self.width} {self.height + _TICKS_PX}"
        drawing = element("svg.plot", *axis, *parts, viewBox=whole, role="img", aria_label=title)
        return element("figure", element("figcaption", title), drawing)


def tick_seconds(first: float, last: float) -> list[tuple[float, str]]:
    """Return round times of an axis with their texts."""
    return [(value, f"{words} s") for value, words in ticks(first, last, most=8)]


def line_legend(entries: Sequence[tuple[str, str]]) -> Html:
    """Return a legend from kinds and texts."""
    spans = []
    for kind, text in entries:
        line = element(f"path.line.{kind}", d="M0,5 22,5")
        spans.append(element("span", element("svg", line, width="22", height="10"), f" {text} "))
    return element("p.soft.legend", *spans)


def metric_title(column: str, metric: Metric) -> str:
    """Return the printed name of a column of a metric with its unit."""
    return metric.titled() + (", mean" if column.endswith("_mean") else "")
