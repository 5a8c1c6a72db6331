"""CommonRoad file as it stands: its XML, and what was found wrong in it.

commonroad-io stops at the first broken element, often with a bare assertion. A file is read here with the
standard library, so that all that is sound in it counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.converters.formats import number
from scex_sumo.converters.lanelet.file import Findings, parse_xml
from scex_sumo.errors import MapError

SUFFIXES = (".xml", ".xml.gz")
VERSIONS = ("2018b", "2020a")
LARGEST_ID = 2**53  # ids go through floats in other tools; SUMO and JSON keep these
_ROOTS = {
    "osm": "it is an OSM file, rename it to .osm for Lanelet2",
    "net": "it is a SUMO net already",
    "OpenDRIVE": "it is OpenDRIVE; rename it to .xodr",
}


@dataclass(kw_only=True, eq=False)
class CommonRoadFile(Findings):
    """The contents of one CommonRoad file.

    Attributes:
        path: where it was read.
        root: its XML.
        remarks: further notes, as they are.
    """

    path: Path
    root: ElementTree.Element
    remarks: list[str] = field(default_factory=list)

    def notes(self) -> tuple[str, ...]:
        """One short sentence for each thing found, naming ids, and the remarks."""
        return (*super().notes(), *self.remarks)

    def elements(self, tag: str) -> dict[int, ElementTree.Element]:
        """Elements of a tag right below the root by id, ascending; the first of those with one id."""
        known: dict[int, ElementTree.Element] = {}
        for element in self.root.findall(tag):
            own = element_id(element)
            if own is not None:
                known.setdefault(own, element)
        return dict(sorted(known.items()))

    @property
    def country(self) -> str:
        """Three letters of the country whose signs the file has, e.g. ``DEU``; from its benchmark id."""
        return self.root.get("benchmarkID", "").removeprefix("C-")[:3]

    @property
    def origin(self) -> tuple[float, float] | None:
        """Latitude and longitude of the file's location, or None where it has none."""
        texts = [self.root.findtext(f"location/{name}") for name in ("gpsLatitude", "gpsLongitude")]
        lat, lon = (coordinate(text) for text in texts)
        # 999 and -999 stand for unknown.
        return (lat, lon) if abs(lat) <= 90 and abs(lon) <= 180 else None


def open_commonroad(path: str | Path) -> CommonRoadFile:
    """Open a CommonRoad map.

    Args:
        path: an ``.xml`` file, or one compressed as ``.xml.gz``.

    Raises:
        MapError: the file is missing, not XML, no CommonRoad file, of an unknown version, or has no lanelet.
    """
    path = Path(path)
    root = parse_commonroad(path)
    if root.find("lanelet") is None:
        raise MapError(f"{path}: a CommonRoad file without lanelets; name one with a road network")
    return CommonRoadFile(path=path, root=root)


def parse_commonroad(path: Path) -> ElementTree.Element:
    """Root of a CommonRoad file.

    Raises:
        MapError: the file is missing, not XML, no CommonRoad file, or of an unknown version.
    """
    root = parse_xml(path, "CommonRoad", ".xml")
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
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else 0
    return value if 0 < value < LARGEST_ID else None


def coordinate(text: str | None) -> float:
    """Number that a text is, or nan; no coordinate, time or size of a scenario is 1e9 or more."""
    value = number(text)
    return value if abs(value) < 1e9 else math.nan
