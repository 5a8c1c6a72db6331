"""Time line of a recording: P of a contact of the most critical pair of each moment; and a map of places."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.page.figures.charts import Plane, tick_seconds
from scex_sumo.page.html import Html, element, joined
from scex_sumo.page.picture import scene_svg
from scex_sumo.page.report.scene import Box
from scex_sumo.results.tables.pairs import arrow, once_in, one_in

_FLOOR: Final = 1e-7  # P below which nothing is drawn
_LINES: Final = (-6, -4, -2)  # powers of ten
_WIDE_PX, _HIGH_PX = 1000, 96
_USUAL: Final = (0.1, 0.9)  # quantiles
_FEWEST: Final = 10  # moments of a site that has a usual level
_MARKS_M: Final = 420  # width of a map on which a mark is as large in m as it is in px on a time line

SHAPES: Final[Mapping[str, str]] = {
    "rear-end": "m0,-5 5,9h-10z",
    "merging": "m0,-5.5 5.5,5.5-5.5,5.5-5.5,-5.5z",
    "crossing": "m-4.5,-3 1.5,-1.5 3,3 3,-3 1.5,1.5-3,3 3,3-1.5,1.5-3,-3-3,3-1.5,-1.5 3,-3z",
    "oncoming": "m-4,-4h8v8h-8z",
    "beside": "m-4,0a4,4 0 1,0 8,0a4,4 0 1,0 -8,0z",
    "person": "m-1.2,-5.5h2.4v4.3h4.3v2.4h-4.3v4.3h-2.4v-4.3h-4.3v-2.4h4.3z",
}
"""Outline of a mark by the kind of conflict, `scex_sumo.decision.words.WHAT`."""


@dataclass(frozen=True, kw_only=True)
class Happening:
    """Most critical pair of a moment: its place, m, and the address of its card or report, or empty."""

    time_s: float
    probability: float
    what: str
    words: str
    x: float = 0.0
    y: float = 0.0
    link: str = ""

    @classmethod
    def of(cls, pair: Mapping[str, Any], time_s: float, link: str = "") -> Happening:
        """Return the happening of a row of ``pairs.parquet``."""
        words = f"{time_s:g} s, {arrow(pair)}: {pair['how'] or pair['what']}; {once_in(pair['probability'])}"
        own = {name: pair[name] for name in ("probability", "what", "x", "y")}
        return cls(time_s=time_s, words=words, link=link, **own)

    def mark(self, where: str, transform: str = "") -> Html:
        """Return the mark with its tooltip, that a click on leads to the card of."""
        more = {"transform": transform} if transform else {}
        shape = element("path.dot.likely", element("title", self.words), d=where + SHAPES[self.what], **more)
        return element("a", shape, href=self.link) if self.link else shape


def usual_level(probabilities: Sequence[float]) -> tuple[float, float] | None:
    """Return the P between which the moments of a site mostly are; None of too few."""
    if len(probabilities) < _FEWEST:
        return None
    low, high = np.quantile(probabilities, _USUAL).tolist()
    return low, high


def timeline(
    title: str,
    happenings: Sequence[Happening],
    span: tuple[float, float],
    name: str = "",
    usual: tuple[float, float] | None = None,
) -> Html:
    """Return the time line of a recording over a span, s, with the `usual_level` as a band.

    The script that selects a span takes the name of the recording from it.
    """
    plane = Plane(x=(span[0], max(span[1], span[0] + 1.0)), y=(-7.0, 0.0), width=_WIDE_PX, height=_HIGH_PX)
    parts = list[Html]()
    if usual is not None:
        low, high = _level(np.array(usual)).tolist()
        parts.append(plane.box(plane.x, (low, high), "soft"))
    for power in _LINES:
        parts.append(plane.line(np.array(plane.x), np.full(2, power), "soft", dashed=True))
        parts.append(plane.words(plane.x[0], power + 0.25, f"once in {one_in(10.0**power)}", anchor="start"))
    for happening in happenings:
        if happening.probability >= _FLOOR:
            x, y = plane.at(happening.time_s, float(_level(np.array(happening.probability))))
            parts.append(happening.mark(f"M{x:g},{y:g}"))
    figure = plane.figure(title, *parts, marks=tick_seconds(*plane.x))
    first, last = (f"{value:g}" for value in plane.x)
    return element("div.timeline", figure, data_recording=name, data_first=first, data_last=last)


def shapes_legend(kinds: Iterable[str], *, usual: bool = False) -> Html:
    """Return what the marks of kinds of conflicts look like."""
    there, parts = set(kinds), list[str]()
    for kind in (kind for kind in SHAPES if kind in there):
        sample = element("path.dot.likely", d=f"M7,7{SHAPES[kind]}")
        parts += [element("span", element("svg", sample, width="14", height="14"), f" {kind} "), " "]
    band = [element("span", "band: where most moments of the site are")] if usual else []
    return element("p.soft.legend", joined(*parts, *band))


def place_map(name: str, box: Box, road: Html, happenings: Sequence[Happening]) -> Html:
    """Return a map with the places of conflicts, on a road as of `scex_sumo.page.picture.road_svg`."""
    size = (box[1] - box[0]) / _MARKS_M
    scale = f"scale({size:.2f} {-size:.2f})"
    marks = [
        happening.mark("M0,0", f"translate({happening.x:.1f} {happening.y:.1f}) {scale}")
        for happening in happenings
    ]
    return element("figure", element("figcaption", name), scene_svg(name, box, road, marks))


def _level(probability: FloatArray) -> FloatArray:
    return np.asarray(np.log10(np.maximum(probability, _FLOOR)))
