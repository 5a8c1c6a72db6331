"""CommonRoad file: its XML, its lanelets as plain data, and notes about defects.

Broken parts are mended or left out: commonroad-io stops at the first broken element; the standard library
keeps the sound ones.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.file import Findings
from scex_sumo.converters.naming import number
from scex_sumo.converters.xml import xml_root
from scex_sumo.geometry.polylines import arc_lengths

VERSIONS = ("2018b", "2020a")
MAX_ID = 2**53  # other tools keep ids as floats
_ROOTS = {
    "osm": "it is an OSM file, rename it to .osm for Lanelet2",
    "net": "it is a SUMO net already",
    "OpenDRIVE": "it is OpenDRIVE; rename it to .xodr",
}


@dataclass(kw_only=True, eq=False)
class CommonRoadFile(Findings):
    """The contents of one CommonRoad file; ``remarks`` are complete notes."""

    path: Path
    root: ElementTree.Element
    remarks: list[str] = field(default_factory=list)

    def notes(self) -> tuple[str, ...]:
        """One short sentence with ids for each kind of defect, and the remarks."""
        return (*super().notes(), *self.remarks)

    def elements(self, tag: str) -> dict[int, ElementTree.Element]:
        """Elements of a tag right below the root by ascending id; the first of several with one id."""
        by_id: dict[int, ElementTree.Element] = {}
        for element in self.root.findall(tag):
            number = element_id(element)
            if number is not None:
                by_id.setdefault(number, element)
        return dict(sorted(by_id.items()))

    @property
    def country(self) -> str:
        """Three letters of the signs' country, e.g. ``DEU``, from the benchmark id."""
        return self.root.get("benchmarkID", "").removeprefix("C-")[:3]

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the file's location; None if it has none."""
        texts = [self.root.findtext(f"location/{name}") for name in ("gpsLatitude", "gpsLongitude")]
        lat, lon = (coordinate(text) for text in texts)
        # 999 and -999 stand for unknown.
        return (lat, lon) if abs(lat) <= 90 and abs(lon) <= 180 else None


def open_commonroad(path: str | Path) -> CommonRoadFile:
    """Open a CommonRoad map, ``.xml`` or ``.xml.gz``."""
    path = Path(path)
    root = parse_commonroad(path)
    if root.find("lanelet") is None:
        raise MapError(f"{path}: a CommonRoad file without lanelets; name one with a road network")
    return CommonRoadFile(path=path, root=root)


def parse_commonroad(path: Path) -> ElementTree.Element:
    """Root of a CommonRoad file."""
    root = xml_root(path, remedy="name a CommonRoad .xml file")
    if root.tag != "commonRoad":
        what = _ROOTS.get(root.tag, "name a CommonRoad scenario")
        raise MapError(f"{path}: no CommonRoad file, its root is <{root.tag}>: {what}")
    version = root.get("commonRoadVersion", "")
    if version not in VERSIONS:
        raise MapError(
            f"{path}: CommonRoad version {version[:24]!r}; {' and '.join(VERSIONS)} can be read, write it "
            "anew with commonroad-io"
        )
    return root


def element_id(element: ElementTree.Element, attribute: str = "id") -> int | None:
    """Id of an element; None if it is not a positive number."""
    text = element.get(attribute, "").strip()
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else 0
    return value if 0 < value < MAX_ID else None


def coordinate(text: str | None) -> float:
    """Number that a text holds, or nan; a coordinate, time or size is below 1e9."""
    value = number(text)
    return value if abs(value) < 1e9 else math.nan


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanelet:
    """One lanelet as the file has it; relations and signs by id; bounds (P, 2 or 3) in m.

    Attributes:
        types: ``urban``, ``highway``, ``sidewalk``, ...
        one_way: road users along its direction, ``vehicle``, ``car``, ``bus``, ...; ``both_ways`` so.
        left_marking: ``solid``, ``dashed``, ...
        stop_line: (2, 2) ends, m.
        speed_limit: as written on the lanelet itself (2018b), m/s.
    """

    left: FloatArray
    right: FloatArray
    centre: FloatArray
    types: frozenset[str]
    one_way: frozenset[str]
    both_ways: frozenset[str]
    left_marking: str
    right_marking: str
    successors: frozenset[int]
    predecessors: frozenset[int]
    left_neighbour: int | None
    right_neighbour: int | None
    signs: frozenset[int]
    lights: frozenset[int]
    stop_line: FloatArray | None
    speed_limit: str | None


def read_lanelets(file: CommonRoadFile, words: Mapping[str, set[str]]) -> dict[int, Lanelet]:
    """Read usable lanelets by ascending id; ``words``: words of CommonRoad by tag.

    Defects of the others go into the file's notes.
    """
    usable: dict[int, tuple[ElementTree.Element, FloatArray, FloatArray]] = {}
    for xml in file.root.findall("lanelet"):
        i = element_id(xml)
        if i is None:
            file.note("lanelets left out, their id is no positive number", xml.get("id", "")[:24] or "none")
        elif i in usable:
            file.note("ids used twice, the first lanelet kept", i)
        elif (bounds := _bounds(xml, i, file)) is not None:
            usable[i] = (xml, *bounds)
    read = _Reader(file, usable.keys(), words)
    return {i: read.lanelet(i, *parts) for i, parts in sorted(usable.items())}


class _Reader:
    """Reader of lanelets; what a file does not have, or CommonRoad, is left out and noted."""

    def __init__(self, file: CommonRoadFile, ids: Collection[int], words: Mapping[str, set[str]]) -> None:
        self._file, self._words = file, words
        names = {"trafficSignRef": "trafficSign", "trafficLightRef": "trafficLight"}
        self._known = {tag: file.elements(name).keys() for tag, name in names.items()}
        self._ids = ids

    def lanelet(self, i: int, xml: ElementTree.Element, left: FloatArray, right: FloatArray) -> Lanelet:
        stop_line, line = next(self._stop_lines(i, xml, left, right), (None, None))
        parents = [xml] if line is None else [xml, line]
        markings = [self._said(i, "lineMarking", xml.find(name)) for name in ("leftBound", "rightBound")]
        left_marking, right_marking = (next(iter(found), "unknown") for found in markings)
        return Lanelet(
            left=left,
            right=right,
            centre=0.5 * (left + right),
            types=frozenset(self._said(i, "laneletType", xml)),
            one_way=frozenset(self._said(i, "userOneWay", xml)),
            both_ways=frozenset(self._said(i, "userBidirectional", xml)),
            left_marking=left_marking,
            right_marking=right_marking,
            successors=frozenset(self._refs(i, "successor", xml)),
            predecessors=frozenset(self._refs(i, "predecessor", xml)),
            left_neighbour=self._neighbour(i, "adjacentLeft", xml),
            right_neighbour=self._neighbour(i, "adjacentRight", xml),
            signs=frozenset(ref for parent in parents for ref in self._refs(i, "trafficSignRef", parent)),
            lights=frozenset(ref for parent in parents for ref in self._refs(i, "trafficLightRef", parent)),
            stop_line=stop_line,
            speed_limit=xml.findtext("speedLimit"),
        )

    def _refs(self, i: int, tag: str, parent: ElementTree.Element) -> dict[int, ElementTree.Element]:
        children: dict[int, ElementTree.Element] = {}
        for child in parent.findall(tag):
            target = element_id(child, "ref")
            if (
                target in self._known.get(tag, self._ids)
                and target is not None
                and (tag in self._known or target != i)
            ):
                children.setdefault(target, child)
            else:
                self._file.note(f"lanelets with a {tag} that is not there, dropped", i)
        return children

    def _neighbour(self, i: int, tag: str, xml: ElementTree.Element) -> int | None:
        target, child = next(iter(self._refs(i, tag, xml).items()), (None, xml))
        return target if child.get("drivingDir") == "same" else None

    def _said(self, i: int, tag: str, parent: ElementTree.Element | None) -> list[str]:
        texts = [child.text or "" for child in parent.findall(tag)] if parent is not None else []
        if not self._words[tag].issuperset(texts):
            self._file.note(f"lanelets with a {tag} that CommonRoad does not have, left out", i)
        return [text for text in texts if text in self._words[tag]]

    def _stop_lines(
        self, i: int, xml: ElementTree.Element, left: FloatArray, right: FloatArray
    ) -> Iterator[tuple[FloatArray, ElementTree.Element]]:
        for line in xml.findall("stopLine"):
            ends = _points(line)[:, :2]
            usable = len(ends) in (0, 2) and bool(np.isfinite(ends).all())
            if usable and line.findtext("lineMarking") in self._words["lineMarking"]:
                yield (ends if len(ends) else np.array([left[-1, :2], right[-1, :2]])), line
            else:
                self._file.note("lanelets with an unusable stop line, left out", i)


def _bounds(xml: ElementTree.Element, i: int, file: CommonRoadFile) -> tuple[FloatArray, FloatArray] | None:
    elements = [xml.find(name) for name in ("leftBound", "rightBound")]
    lines = [_points(element) for element in elements if element is not None]
    if len(lines) < 2:
        file.note("lanelets left out, a bound is missing", i)
        return None
    if not all(np.isfinite(line).all() for line in lines):
        file.note("lanelets left out, a bound has no usable coordinates", i)
        return None
    if any(len(np.unique(line, axis=0)) < 2 for line in lines):
        file.note("lanelets left out, a bound is shorter than two points", i)
        return None
    width = min(line.shape[1] for line in lines)
    left, right = (line[:, :width] for line in lines)
    if len(left) == len(right):
        return left, right
    file.note("lanelets with unequally many points on their bounds, points put in between", i)
    # Each bound gets a point at the same share of its length as each point of the other one.
    arcs = [arc_lengths(line) for line in (left, right)]
    shares = [arc / arc[-1] for arc in arcs]
    every = np.unique(np.concatenate(shares))
    left, right = (
        np.stack([np.interp(every, share, line[:, k]) for k in range(width)], axis=1)
        for share, line in zip(shares, (left, right), strict=True)
    )
    return left, right


def _points(line: ElementTree.Element) -> FloatArray:
    points = line.findall("point")
    names = ("x", "y", "z") if points and all(p.find("z") is not None for p in points) else ("x", "y")
    return np.array([[coordinate(p.findtext(name)) for name in names] for p in points]).reshape(
        -1, len(names)
    )
