"""Roads of OpenDRIVE: their reference lines, and pieces with the same lanes from end to end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
from numpy.polynomial.polynomial import polyval

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.naming import number as number_in

Name: TypeAlias = tuple[str, int, int]  # road, piece, lane

MIN_WIDTH_M = 1.0  # narrower lanes are not there yet, or no longer
APART_M = 1.0  # between places where a road's lanes change
KINDS = {
    **dict.fromkeys(("driving", "entry", "exit", "offRamp", "onRamp", "connectingRamp"), "vehicle"),
    **dict.fromkeys(("slipLane", "bidirectional", "HOV"), "vehicle"),
    **dict.fromkeys(("bus", "taxi"), "bus"),
    "biking": "bicycle",
    **dict.fromkeys(("sidewalk", "walking"), "pedestrian"),
}
"""Kinds of lanes by their types; others are closed to all."""
SAGITTA_M = 0.002  # between a curve and the line through its points
STEP_M = (0.1, 1.0)  # between points
MAX_POINTS = 1_000_000  # of a road
SHORT_M = 1e-6  # a stretch without length
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def number(element: Element, name: str, default: str | None = None) -> float:
    """Return an attribute; `ValueError` if it is not a finite number."""
    text = element.get(name, default)
    value = number_in(text)
    if not math.isfinite(value):
        raise ValueError(f"{name} of its {element.tag} is {str(text)[:24]!r}")
    return value


def polynomial(records: Sequence[Element], key: str, s: FloatArray) -> FloatArray:
    """Return the values at stations of cubics that each hold from their own station ``key`` on; else 0."""
    table = np.array([[number(record, name, "0") for name in (key, *"abcd")] for record in records])
    if not len(table):
        return np.zeros(len(s))
    table = table[np.argsort(table[:, 0], kind="stable")]
    k = np.searchsorted(table[:, 0], s + SHORT_M, side="right") - 1
    start, a, b, c, d = table[np.maximum(k, 0)].T
    u = s - start
    return np.where(k >= 0, a + u * (b + u * (c + u * d)), 0.0)


class ReferenceLine:
    """Reference line of a road: lines, arcs, spirals and polynomials in a row.

    Attributes:
        s: (S,) m, stations so dense that straight lines between them are within 2 mm.
        places: (S, 2) m; ``headings`` (S,) rad.
    """

    @np.errstate(invalid="ignore", over="ignore")  # of a damaged file; its road is refused
    def __init__(self, road: Element, breaks: Sequence[float]) -> None:
        """``breaks``: stations that are among ``s``."""
        stretches = [(number(x, "s"), abs(number(x, "length")), x) for x in road.findall("planView/geometry")]
        stretches = sorted(stretches, key=lambda entry: entry[0])
        stretches = [entry for entry in stretches if entry[1] > SHORT_M] or stretches[:1]
        if not stretches:
            raise ValueError("it has no geometry")
        parts = [(start, _Stretch(x, length)) for start, length, x in stretches]
        end = float(stretches[-1][0] + stretches[-1][1])
        rows = [np.asarray([x for x in breaks if 0.0 <= x <= end])]
        for start, stretch in parts:
            count = math.ceil(stretch.length / stretch.step_m) + 1
            if count > MAX_POINTS:
                raise ValueError(f"length of its geometry is {stretch.length:.3g} m")
            rows.append(start + np.linspace(0.0, stretch.length, count))
        s = np.unique(np.concatenate(rows))
        self.s = s[np.append(True, np.diff(s) > SHORT_M)]
        starts = np.array([start for start, _ in parts])
        of = np.clip(np.searchsorted(starts, self.s + SHORT_M, side="right") - 1, 0, None)
        self.places, self.headings = np.empty((len(self.s), 2)), np.empty(len(self.s))
        for k, (start, stretch) in enumerate(parts):
            within = of == k
            self.places[within], self.headings[within] = stretch.at(self.s[within] - start)

    def beside(self, t: FloatArray, rows: slice) -> FloatArray:
        """Return the points (n, 2) to the left of stations by ``t`` m."""
        heading = self.headings[rows]
        return np.asarray(
            self.places[rows] + t[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])
        )


class _Stretch:
    def __init__(self, element: Element, length: float) -> None:
        self.length = length
        self._x, self._y, self._heading = (number(element, name) for name in ("x", "y", "hdg"))
        self._cubic = None
        self._curvatures = 0.0, 0.0
        for shape in element:
            if shape.tag == "arc":
                self._curvatures = (number(shape, "curvature"),) * 2
            elif shape.tag == "spiral":
                self._curvatures = number(shape, "curvStart"), number(shape, "curvEnd")
            elif shape.tag == "paramPoly3":
                u, v = ([number(shape, f"{k}{axis}", "0") for k in "abcd"] for axis in "UV")
                self._cubic = u, v, length if shape.get("pRange") == "arcLength" else 1.0, True
            elif shape.tag == "poly3":
                self._cubic = [0, 1, 0, 0], [number(shape, k, "0") for k in "abcd"], length, False
        ds = np.linspace(0.0, length, 33)
        turned = np.unwrap(self.at(ds)[1])
        sharpest = float(np.abs(np.diff(turned)).max()) / max(length / 32, SHORT_M)
        self.step_m = float(np.clip(math.sqrt(8 * SAGITTA_M / max(sharpest, 1e-9)), *STEP_M))

    def at(self, ds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return places and headings at distances from its beginning."""
        u, v, turned = self._by_curvature(ds) if self._cubic is None else self._by_cubic(ds)
        c, s = math.cos(self._heading), math.sin(self._heading)
        return np.column_stack([self._x + c * u - s * v, self._y + s * u + c * v]), self._heading + turned

    def _by_curvature(self, ds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        first, last = self._curvatures
        rate = (last - first) / max(self.length, SHORT_M)
        half = np.diff(ds, prepend=0.0)[:, None] / 2
        between = ds[:, None] - half + half * _NODES
        angle = between * (first + rate / 2 * between)
        u, v = (np.cumsum((half * _WEIGHTS * wave(angle)).sum(axis=1)) for wave in (np.cos, np.sin))
        return u, v, ds * (first + rate / 2 * ds)

    def _by_cubic(self, ds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        assert self._cubic is not None
        u, v, last, whole = self._cubic
        grid = np.linspace(0.0, last, max(65, min(MAX_POINTS, math.ceil(4 * self.length))))
        arc = np.append(0.0, np.cumsum(np.hypot(np.diff(polyval(grid, u)), np.diff(polyval(grid, v)))))
        scale = arc[-1] / max(self.length, SHORT_M) if whole else 1.0
        p = np.interp(ds * scale, arc, grid)
        return polyval(p, u), polyval(p, v), np.arctan2(_slope(v, p), _slope(u, p))


def _slope(abcd: Sequence[float], p: FloatArray) -> FloatArray:
    _, b, c, d = abcd
    return np.asarray(b + p * (2 * c + p * 3 * d))


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Piece of a road.

    Attributes:
        rows: of the reference line's stations, (n,).
        s: (n,) m.
        lanes: ids of the lanes that are there.
        elements: all lanes of its section by id, the centre lane too.
        borders: by lane id (2, n) m, how far its right and left border are left of the reference line.
        section: number of its lane section, which begins at ``section_s``.
    """

    rows: slice
    s: FloatArray
    lanes: tuple[int, ...]
    elements: Mapping[int, Element]
    borders: Mapping[int, FloatArray]
    section: int
    section_s: float

    @property
    def length_m(self) -> float:
        """Its length along the reference line."""
        return float(self.s[-1] - self.s[0])

    @property
    def middle_s(self) -> float:
        """Station of its middle, m."""
        return float(self.s[0] + self.s[-1]) / 2

    def mark(self, lane: int) -> Element:
        """Return the road mark of a lane's outer border at the middle; an empty one if there is none."""
        marks = [] if lane not in self.elements else self.elements[lane].findall("roadMark")
        there = self.middle_s - self.section_s
        return next((x for x in marks[::-1] if number(x, "sOffset", "0") <= there), Element("roadMark"))


class DrawnRoad:
    """A road: its reference line and its pieces.

    Attributes:
        inside: whether it lies in a junction.
        left_hand: traffic drives on the left.
    """

    def __init__(self, path: Path, element: Element) -> None:
        self.element, self.name = element, element.get("id", "")
        self.inside = element.get("junction", "-1") not in ("-1", "")
        self.left_hand = element.get("rule", "RHT").upper() == "LHT"
        try:
            sections = sorted(element.findall("lanes/laneSection"), key=lambda x: number(x, "s"))
            starts = [max(number(section, "s"), 0.0) for section in sections]
            self.line = ReferenceLine(element, starts)
            self.pieces = [piece for k in range(len(sections)) for piece in self._pieces(sections, starts, k)]
        except ValueError as error:
            where = f"{path}: road {self.name}: {error}"
            raise MapError(f"{where}; repair the file or leave the road out") from None

    def names(self) -> Iterator[Name]:
        """Yield the lanes of all pieces."""
        for k, piece in enumerate(self.pieces):
            yield from ((self.name, k, lane) for lane in piece.lanes)

    def forward(self, piece: int, lane: int) -> bool:
        """Whether a lane is driven along the reference line."""
        turned = self.pieces[piece].elements[lane].get("direction") == "reversed"
        return (lane < 0) != (self.left_hand != turned)

    def piece_at(self, s: float) -> int:
        """Return the piece at a station."""
        ends = [self.line.s[piece.rows.stop - 1] for piece in self.pieces]
        return min(int(np.searchsorted(ends, s)), len(ends) - 1)

    def place(self, index: int, lane: int, s: float) -> FloatArray:
        """Return the middle (2,) of a lane at a station, m."""
        piece = self.pieces[index]
        k = piece.rows.start + int(np.argmin(np.abs(piece.s - s)))
        middle = piece.borders[lane][:, k - piece.rows.start].mean(keepdims=True)
        return np.asarray(self.line.beside(middle, slice(k, k + 1))[0])

    def type_at(self, s: float) -> Element:
        """Return the type of the road at a station; an empty one if there is none."""
        types = sorted(self.element.findall("type"), key=lambda x: number(x, "s", "0"))
        return next((x for x in types[::-1] if number(x, "s", "0") <= s), Element("type"))

    @cached_property
    def heights(self) -> FloatArray:
        """(S,) m."""
        return polynomial(self.element.findall("elevationProfile/elevation"), "s", self.line.s)

    def _pieces(self, sections: list[Element], starts: list[float], k: int) -> Iterator[Piece]:
        s = self.line.s
        first = int(np.searchsorted(s, starts[k] - 1e-6))
        last = len(s) - 1  # sections that begin beyond it are not there
        if k + 1 < len(starts):
            last = min(int(np.searchsorted(s, starts[k + 1] - 1e-6)), last)
        if last <= first:
            return
        rows = slice(first, last + 1)
        elements = {int(number(x, "id")): x for x in sections[k].iter("lane")}
        borders = self._borders(elements, rows, starts[k])
        driven = [i for i in borders if elements[i].get("type", "") in KINDS]
        wide = {i: _wide(elements[i], np.diff(borders[i], axis=0)[0]) for i in driven}
        there = np.array([*wide.values()]).reshape(-1, last + 1 - first)
        cuts = [0]
        for station in (np.flatnonzero((there[:, 1:] != there[:, :-1]).any(axis=0)) + 1).tolist():
            if min(s[first + station] - s[first + cuts[-1]], s[last] - s[first + station]) > APART_M:
                cuts.append(station)
        for begin, end in zip(cuts, [*cuts[1:], last - first], strict=True):
            span = slice(begin, end + 1)
            yield Piece(
                rows=slice(first + begin, first + end + 1),
                s=s[first + begin : first + end + 1],
                lanes=tuple(i for i in sorted(borders) if i not in wide or wide[i][span].mean() > 0.5),
                elements=elements,
                borders={i: both[:, span] for i, both in borders.items()},
                section=k,
                section_s=starts[k],
            )

    def _borders(self, lanes: Mapping[int, Element], rows: slice, start: float) -> dict[int, FloatArray]:
        # Where two records meet, the end of a section has those of before.
        s = np.minimum(self.line.s[rows], self.line.s[rows.stop - 1] - 1e-5)
        borders = {}
        for side in (1, -1):
            inner = polynomial(self.element.findall("lanes/laneOffset"), "s", s)
            for lane in sorted((i for i in lanes if i * side > 0), key=abs):
                widths, direct = lanes[lane].findall("width"), lanes[lane].findall("border")
                if direct and not widths:
                    outer = side * np.abs(polynomial(direct, "sOffset", s - start))
                else:
                    outer = inner + side * np.maximum(polynomial(widths, "sOffset", s - start), 0.0)
                borders[lane] = np.stack([inner, outer][::side])
                inner = outer
        return borders


def _wide(lane: Element, width: FloatArray) -> BoolArray:
    """Return where a lane is there: where it is wide, and up to the ends at which others follow it."""
    there = np.asarray(width >= MIN_WIDTH_M)
    first, last = (int(np.argmax(x)) if there.any() else len(there) for x in (there, there[::-1]))
    there[:first] |= lane.find("link/predecessor") is not None
    there[len(there) - last :] |= lane.find("link/successor") is not None
    return there
