"""A Lanelet2 map as it stands in its file: nodes, ways and relations, before Lanelet2 reads them.

Lanelet2 drops what it cannot use without a word, or crashes on it. What a map really says, and what is
broken in it, is found here with the standard library alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.errors import MapError

Tags = Mapping[str, str]
ParsedElement = tuple[str, int, ElementTree.Element]


@dataclass(frozen=True, kw_only=True, slots=True)
class Node:
    """A point of the map: latitude and longitude in degrees, elevation in m."""

    lat: float
    lon: float
    ele: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Way:
    """A polyline: ids of its nodes, in order, and its tags."""

    nodes: tuple[int, ...]
    tags: Tags


@dataclass(frozen=True, kw_only=True, slots=True)
class Member:
    """One member of a relation: ``node``, ``way`` or ``relation``, its id and its role."""

    kind: str
    ref: int
    role: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Relation:
    """A lanelet, area or regulatory element: its members, in order, and its tags."""

    members: tuple[Member, ...]
    tags: Tags

    def refs(self, role: str, kind: str) -> tuple[int, ...]:
        """Ids of the members of a role and kind, in order."""
        return tuple(m.ref for m in self.members if m.role == role and m.kind == kind)


@dataclass(frozen=True, kw_only=True, eq=False)
class MapFile:
    """The contents of one map file.

    Attributes:
        path: where it was read.
        nodes: by id.
        ways: by id.
        relations: by id.
        notes: what could not be read, one short sentence each.
    """

    path: Path
    nodes: dict[int, Node] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: dict[int, Relation] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def of_type(self, kind: str) -> dict[int, Relation]:
        """Relations whose ``type`` tag is ``kind``, by ascending id."""
        found = {i: r for i, r in self.relations.items() if r.tags.get("type") == kind}
        return dict(sorted(found.items()))


def list_ids(ids: Iterable[int], limit: int = 5) -> str:
    """Write ids for a message: the first few, then how many more there are."""
    ordered = sorted(set(ids))
    shown = ", ".join(str(i) for i in ordered[:limit])
    rest = len(ordered) - limit
    return f"{shown} and {rest} more" if rest > 0 else shown


def read_map_file(path: str | Path) -> MapFile:
    """Read a map file's elements; what is marked as deleted is left out, as Lanelet2 does.

    Args:
        path: an ``.osm`` file.

    Raises:
        MapError: the file is missing, is no file, is not XML, or is not an OSM file.
    """
    path = Path(path)
    root = _parse(path)
    nodes: dict[int, Node] = {}
    ways: dict[int, Way] = {}
    relations: dict[int, Relation] = {}
    unreadable: list[str] = []
    for element in root:
        if element.tag not in ("node", "way", "relation") or element.get("action") == "delete":
            continue
        try:
            element_id = int(element.attrib["id"])
            if element.tag == "node":
                nodes[element_id] = _node(element)
            elif element.tag == "way":
                refs = tuple(int(nd.attrib["ref"]) for nd in element.iter("nd"))
                ways[element_id] = Way(nodes=refs, tags=_tags(element))
            else:
                relations[element_id] = Relation(members=_members(element), tags=_tags(element))
        except (KeyError, ValueError):
            unreadable.append(f"{element.tag} {element.get('id', 'without an id')}")
    notes = (f"unreadable: {', '.join(unreadable[:5])}",) if unreadable else ()
    return MapFile(path=path, nodes=nodes, ways=ways, relations=relations, notes=notes)


def _parse(path: Path) -> ElementTree.Element:
    if path.is_dir():
        raise MapError(f"{path}: is a folder; name the .osm file in it")
    if not path.is_file():
        raise MapError(f"{path}: no such map; name a Lanelet2 .osm file")
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise MapError(f"{path}: not XML ({error}); name a Lanelet2 .osm file") from None
    except (OSError, UnicodeError, ValueError, LookupError) as error:
        raise MapError(f"{path}: cannot be read ({error})") from None
    if root.tag != "osm":
        raise MapError(f"{path}: no Lanelet2 map: the file's root is <{root.tag}>, not <osm>")
    return root


def _tags(element: ElementTree.Element) -> Tags:
    return {tag.attrib["k"]: tag.attrib["v"] for tag in element.iter("tag")}


def _node(element: ElementTree.Element) -> Node:
    ele = next((tag.get("v", "0") for tag in element.iter("tag") if tag.get("k") == "ele"), "0")
    node = Node(lat=float(element.attrib["lat"]), lon=float(element.attrib["lon"]), ele=float(ele))
    if not (math.isfinite(node.lat) and math.isfinite(node.lon) and math.isfinite(node.ele)):
        raise ValueError("not finite")
    return node


def _members(element: ElementTree.Element) -> tuple[Member, ...]:
    return tuple(
        Member(kind=m.attrib["type"], ref=int(m.attrib["ref"]), role=m.get("role", ""))
        for m in element.iter("member")
    )
