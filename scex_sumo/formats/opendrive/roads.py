"""Roads of OpenDRIVE in pieces with the same lanes from end to end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.formats.opendrive.reference import ReferenceLine, number, polynomial

Name: TypeAlias = tuple[str, int, int]  # road, piece, lane

MIN_WIDTH_M = 1.0  # narrower lanes are not there yet, or no longer
APART_M = 1.0  # between places where a road's lanes change
KINDS = {
    **dict.fromkeys(
        ("driving", "entry", "exit", "offRamp", "onRamp", "connectingRamp", "slipLane"), "vehicle"
    ),
    **dict.fromkeys(("bidirectional", "HOV"), "vehicle"),
    **dict.fromkeys(("bus", "taxi"), "bus"),
    "biking": "bicycle",
    **dict.fromkeys(("sidewalk", "walking"), "pedestrian"),
}
"""Kinds of lanes by their types; others are closed to all."""


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

    def place(self, piece: int, lane: int, s: float) -> FloatArray:
        """Return the middle (2,) of a lane at a station, m."""
        at = self.pieces[piece]
        k = at.rows.start + int(np.argmin(np.abs(at.s - s)))
        middle = at.borders[lane][:, k - at.rows.start].mean(keepdims=True)
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
        for row in (np.flatnonzero((there[:, 1:] != there[:, :-1]).any(axis=0)) + 1).tolist():
            if min(s[first + row] - s[first + cuts[-1]], s[last] - s[first + row]) > APART_M:
                cuts.append(row)
        for begin, end in zip(cuts, [*cuts[1:], last - first], strict=True):
            part = slice(begin, end + 1)
            yield Piece(
                rows=slice(first + begin, first + end + 1),
                s=s[first + begin : first + end + 1],
                lanes=tuple(i for i in sorted(borders) if i not in wide or wide[i][part].mean() > 0.5),
                elements=elements,
                borders={i: both[:, part] for i, both in borders.items()},
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
