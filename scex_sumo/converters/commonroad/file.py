"""A CommonRoad file as it stands: its XML, with what is broken in it mended or left out.

commonroad-io stops at the first broken element, often with a bare assertion. What a file really says, and
what is wrong with it, is found here with the standard library, so that all that is sound can be read.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.lanelet.file import list_ids
from scex_sumo.errors import MapError

SUFFIXES = (".xml", ".xml.gz")
VERSIONS = ("2018b", "2020a")
LARGEST_ID = 2**53  # ids go through floats in other tools; SUMO and JSON keep these
_LINKS = ("successor", "predecessor", "adjacentLeft", "adjacentRight")
_ROOTS = {
    "osm": "it is an OSM file, rename it to .osm for Lanelet2",
    "net": "it is a SUMO net already",
    "OpenDRIVE": "it is OpenDRIVE, which cannot be read; see docs/maps.md",
}


@dataclass(kw_only=True, eq=False)
class CommonRoadFile:
    """The contents of one CommonRoad file.

    Attributes:
        path: where it was read.
        root: its XML; lanelets in it have an id of their own, two bounds with equally many points, and
            refer to nothing that is not there.
        lanelets: elements of the usable lanelets by id, ascending.
        found: what was mended or left out, by sentence; the ids follow it in the note.
        remarks: further notes, as they are.
    """

    path: Path
    root: ElementTree.Element
    lanelets: dict[int, ElementTree.Element] = field(default_factory=dict)
    found: dict[str, set[int | str]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)

    def note(self, sentence: str, element_id: int | str) -> None:
        """Remember what was found about one element."""
        self.found.setdefault(sentence, set()).add(element_id)

    def notes(self) -> tuple[str, ...]:
        """One short sentence for each thing found, naming ids."""
        return (*(f"{sentence}: {list_ids(ids)}" for sentence, ids in self.found.items()), *self.remarks)

    def elements(self, tag: str) -> dict[int, ElementTree.Element]:
        """Elements of a tag right below the root by id, ascending; the first of those with one id."""
        known: dict[int, ElementTree.Element] = {}
        for element in self.root.findall(tag):
            number = element_id(element)
            if number is not None:
                known.setdefault(number, element)
        return dict(sorted(known.items()))

    @property
    def country(self) -> str:
        """Three letters of the country whose signs the file has, e.g. ``DEU``; from its benchmark id."""
        return self.root.get("benchmarkID", "").removeprefix("C-")[:3]

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the file's location, or None where it has none."""
        texts = [self.root.findtext(f"location/{name}") for name in ("gpsLatitude", "gpsLongitude")]
        lat, lon = (_number(text) for text in texts)
        # 999 and -999 stand for unknown.
        return (lat, lon) if abs(lat) <= 90 and abs(lon) <= 180 else None


def read_commonroad_file(path: str | Path) -> CommonRoadFile:
    """Read a CommonRoad file, leave out lanelets without usable bounds, and references to nothing.

    Args:
        path: an ``.xml`` file, or one compressed as ``.xml.gz``.

    Raises:
        MapError: the file is missing, not XML, no CommonRoad file, of an unknown version, or has no
            usable lanelet.
    """
    path = Path(path)
    root = parse_commonroad(path)
    file = CommonRoadFile(path=path, root=root)
    if root.find("lanelet") is None:
        raise MapError(f"{path}: a CommonRoad file without lanelets; name one with a road network")
    _take_lanelets(file)
    if not file.lanelets:
        raise MapError(
            f"{path}: no usable lanelet ({'; '.join(file.notes())}); mend the map, e.g. in CommonRoad's "
            "scenario designer"
        )
    _drop_broken_links(file)
    return file


def parse_commonroad(path: Path) -> ElementTree.Element:
    """Root of a CommonRoad file.

    Raises:
        MapError: the file is missing, not XML, no CommonRoad file, or of an unknown version.
    """
    root = _parse(path)
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
    """Id of an element, or None where it has none that is a positive number."""
    text = element.get(attribute, "").strip()
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else 0
    return number if 0 < number < LARGEST_ID else None


def _parse(path: Path) -> ElementTree.Element:
    if path.is_dir():
        raise MapError(f"{path}: is a folder; name the CommonRoad .xml file in it")
    if not path.is_file():
        raise MapError(f"{path}: no such map; name a CommonRoad .xml file")
    try:
        content = path.read_bytes()
        return ElementTree.fromstring(gzip.decompress(content) if content[:2] == b"\x1f\x8b" else content)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise MapError(f"{path}: cannot be unpacked ({error}); fetch the file again") from None
    except ElementTree.ParseError as error:
        raise MapError(f"{path}: not XML ({error}); name a CommonRoad .xml file") from None
    except (OSError, ValueError, LookupError) as error:
        raise MapError(f"{path}: cannot be read ({error}); name a CommonRoad .xml file") from None


def _take_lanelets(file: CommonRoadFile) -> None:
    found: dict[int, ElementTree.Element] = {}
    for lanelet in file.root.findall("lanelet"):
        number = element_id(lanelet)
        if number is None:
            file.note(
                "lanelets left out, their id is no positive number", lanelet.get("id", "")[:24] or "none"
            )
        elif number in found:
            file.note("ids used twice, the first lanelet kept", number)
        elif _mend_bounds(lanelet, number, file):
            found[number] = lanelet
    file.lanelets = dict(sorted(found.items()))


def _mend_bounds(lanelet: ElementTree.Element, number: int, file: CommonRoadFile) -> bool:
    """Whether a lanelet has two usable bounds; gives both equally many points."""
    bounds = [lanelet.find(name) for name in ("leftBound", "rightBound")]
    if bounds[0] is None or bounds[1] is None:
        file.note("lanelets left out, a bound is missing", number)
        return False
    points = [_points(bound) for bound in bounds if bound is not None]
    if not all(np.isfinite(line).all() for line in points):
        file.note("lanelets left out, a bound has no usable coordinates", number)
        return False
    if any(len(np.unique(line, axis=0)) < 2 for line in points):
        file.note("lanelets left out, a bound is shorter than two points", number)
        return False
    if len(points[0]) != len(points[1]):
        file.note("lanelets with unequally many points on their bounds, points put in between", number)
        for bound, line in zip((bounds[0], bounds[1]), _evened(*points), strict=True):
            _write_points(bound, line)
    return True


def _points(bound: ElementTree.Element) -> FloatArray:
    """(P, 2 or 3) points of a bound; nan where it is no number. Heights count only if all points have one."""
    points = bound.findall("point")
    names = ("x", "y", "z") if points and all(p.find("z") is not None for p in points) else ("x", "y")
    for point in points:
        height = point.find("z")
        if len(names) == 2 and height is not None:
            point.remove(height)
    return np.array([[_number(p.findtext(name)) for name in names] for p in points]).reshape(-1, len(names))


def _number(text: str | None) -> float:
    try:
        number = float(text or "nan")
    except ValueError:
        return math.nan
    return number if abs(number) < 1e9 else math.nan


def _evened(left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same two lines, each with a point wherever the other has one, at the same share of their length."""
    shares = [_shares(line) for line in (left, right)]
    every = np.unique(np.concatenate(shares))
    width = min(left.shape[1], right.shape[1])
    lines = [
        np.stack([np.interp(every, share, line[:, k]) for k in range(width)], axis=1)
        for share, line in zip(shares, (left, right), strict=True)
    ]
    return lines[0], lines[1]


def _shares(line: FloatArray) -> FloatArray:
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    shares: FloatArray = along / along[-1]
    return shares


def _write_points(bound: ElementTree.Element | None, line: FloatArray) -> None:
    if bound is None:
        return
    for point in bound.findall("point"):
        bound.remove(point)
    for place in line:
        point = ElementTree.SubElement(bound, "point")
        for name, value in zip(("x", "y", "z"), place, strict=False):
            ElementTree.SubElement(point, name).text = repr(float(value))


def _drop_broken_links(file: CommonRoadFile) -> None:
    """Drop references of lanelets to lanelets, signs and lights that are not there, or to themselves."""
    signs, lights = file.elements("trafficSign"), file.elements("trafficLight")
    for number, lanelet in file.lanelets.items():
        others = file.lanelets.keys() - {number}
        known: dict[str, Callable[[int], bool]] = {tag: others.__contains__ for tag in _LINKS}
        known["trafficSignRef"] = signs.__contains__
        known["trafficLightRef"] = lights.__contains__
        for parent in (lanelet, *lanelet.findall("stopLine")):
            for child in list(parent):
                if child.tag not in known:
                    continue
                target = element_id(child, "ref")
                if target is None or not known[child.tag](target):
                    parent.remove(child)
                    file.note(f"lanelets with a {child.tag} that is not there, dropped", number)
