"""Charts of a page that need no script: curves, dots and bars on axes, as SVG in the page's colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.page.html import Html, element, joined

_ROUND = (1, 2, 5, 10)
_BELOW_PX = 18
"""Height of the ticks' words."""


def ticks(low: float, high: float, most: int = 4) -> list[tuple[float, str]]:
    """Round numbers within a range, with what is written for each.

    Args:
        low: where the axis begins.
        high: where it ends, above ``low``.
        most: about how many steps it is to have.
    """
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in _ROUND if power * factor >= raw * (1 - 1e-9))
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    return [(number * step, f"{number * step:.{digits}f}") for number in numbers]


@dataclass(frozen=True, kw_only=True)
class Plane:
    """Plane of a chart, in which what is drawn has the coordinates of its axes; upwards is more.

    Kinds of lines are names of colours: drawn, likely, recorded, critical, picked, soft, or c0 to c5.

    Attributes:
        x: least and largest value along the bottom.
        y: least and largest value upwards.
        width: px.
        height: px, without the ticks below.
    """

    x: tuple[float, float]
    y: tuple[float, float] = (0.0, 1.0)
    width: int = 260
    height: int = 110

    def at(self, x: float, y: float) -> tuple[float, float]:
        """A point in px; what is outside is at the edge."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        upwards = (y - self.y[0]) / (self.y[1] - self.y[0])
        px, py = min(max(across, 0.0), 1.0) * self.width, (1 - min(max(upwards, 0.0), 1.0)) * self.height
        return round(px, 1), round(py, 1)

    def line(self, x: FloatArray, y: FloatArray, kind: str, *, dashed: bool = False) -> Html:
        """A line through points."""
        return element(f"path.line.{kind}{'.dashed' if dashed else ''}", d=self._path(x, y))

    def area(self, x: FloatArray, low: FloatArray, high: FloatArray, kind: str) -> Html:
        """What lies between two lines."""
        both = self._path(np.concatenate([x, x[::-1]]), np.concatenate([high, low[::-1]]))
        return element(f"path.area.{kind}", d=both)

    def dot(self, x: float, y: float, kind: str, *, radius: float = 3.0, title: str = "") -> Html:
        """A dot, with words that are shown when the pointer is on it."""
        px, py = self.at(x, y)
        words = [element("title", title)] if title else []
        return element(f"circle.dot.{kind}", *words, cx=f"{px}", cy=f"{py}", r=f"{radius:.1f}")

    def box(self, x: tuple[float, float], y: tuple[float, float], kind: str) -> Html:
        """A filled rectangle."""
        corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
        return element(f"path.area.{kind}", d=self._path(*map(np.array, zip(*corners, strict=True))))

    def words(self, x: float, y: float, text: str, *, anchor: str = "middle", kind: str = "soft") -> Html:
        """Words at a point."""
        px, py = self.at(x, y)
        return element(f"text.{kind}", text, x=f"{px}", y=f"{py}", text_anchor=anchor)

    def _path(self, x: FloatArray, y: FloatArray) -> str:
        points = [self.at(float(px), float(py)) for px, py in zip(x, y, strict=True)]
        return "M" + " ".join(f"{px:g},{py:g}" for px, py in points)

    def figure(
        self, title: str, *parts: Html, marks: Sequence[tuple[float, str]] | None = None, note: str = ""
    ) -> Html:
        """The chart with its axis below.

        Args:
            title: above it.
            parts: what is drawn.
            marks: ticks with their words; None takes round numbers.
            note: below it.
        """
        found = ticks(*self.x) if marks is None else marks
        axis = [element("path.line.axis", d=f"M0,{self.height} {self.width},{self.height}")]
        for value, text in found:
            px = min(max(self.at(value, 0)[0], 10), self.width - 10)
            axis.append(element("text", text, x=f"{px:g}", y=f"{self.height + 14}", text_anchor="middle"))
        whole = f"0 0 {self.width} {self.height + _BELOW_PX}"
        drawing = element("svg.plot", *axis, *parts, viewBox=whole, role="img", aria_label=title)
        below = [element("p.soft", note)] if note else []
        return element("figure", element("figcaption", title), drawing, *below)


def line_legend(entries: Sequence[tuple[str, str]]) -> Html:
    """What the colours mean: pairs of kind and words."""
    return element("p.soft.legend", joined(*(_entry(kind, text) for kind, text in entries)))


def _entry(kind: str, text: str) -> Html:
    stroke = element(f"path.line.{kind}", d="M0,5 22,5")
    return element("span", element("svg", stroke, width="22", height="10"), f" {text} ")
