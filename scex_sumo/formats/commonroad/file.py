"""CommonRoad file: its XML, and notes about defects.

commonroad-io stops at the first broken element; the standard library keeps the sound ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.file import Findings, parse_xml
from scex_sumo.converters.naming import beginning, number

SUFFIXES = (".xml", ".xml.gz")
VERSIONS = ("2018b", "2020a")
MAX_ID = 2**53  # other tools keep ids as floats
_ROOTS = {
    "osm": "it is an OSM file, rename it to .osm for Lanelet2",
    "net": "it is a SUMO net already",
    "OpenDRIVE": "it is OpenDRIVE; rename it to .xodr",
}


def is_commonroad(path: Path) -> bool:
    """Whether a file is a CommonRoad scenario: XML that is not one of SUMO's files, by name or beginning."""
    name = str(path).lower()
    if not name.endswith(SUFFIXES) or name.removesuffix(".gz").endswith((".net.xml", ".fcd.xml")):
        return False
    start = beginning(path)
    return b"<fcd-export" not in start and b"<snapshot" not in start


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
    """Id of an element; None if it is not a positive number."""
    text = element.get(attribute, "").strip()
    value = int(text) if text.isascii() and text.isdigit() and len(text) < 20 else 0
    return value if 0 < value < MAX_ID else None


def coordinate(text: str | None) -> float:
    """Number that a text holds, or nan; a coordinate, time or size is below 1e9."""
    value = number(text)
    return value if abs(value) < 1e9 else math.nan
