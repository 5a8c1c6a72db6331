"""Lanelet2 map file: its nodes, ways and relations, before Lanelet2 reads them.

Lanelet2 silently drops broken elements, or crashes on them.
"""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr as quoted

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, listed
from scex_sumo.converters.xml import xml_root

Tags = Mapping[str, str]
Points: TypeAlias = Mapping[int, FloatArray]
"""(P, 2) points of every way by id, m."""
_ID = re.compile(r"-?[0-9]{1,19}")
MAX_ID = 2**63 - 1  # Lanelet2's ids have 64 bits
MAX_HEIGHT_M = 10_000.0  # no road lies higher
_EARTH = {"lat": 90.0, "lon": 180.0}  # limits
_LOCAL = {"local_y": 9e6, "local_x": 1e6}  # within a square of 100 km, or UTM's


@dataclass(frozen=True, kw_only=True, slots=True)
class MapPoint:
    """Point of the map: latitude and longitude in degrees, elevation in m."""

    lat: float
    lon: float
    ele: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class Way:
    """Polyline: ids of its nodes in order, and its tags."""

    nodes: tuple[int, ...]
    tags: Tags


@dataclass(frozen=True, kw_only=True, slots=True)
class Member:
    """Member of a relation: its kind (``node``, ``way`` or ``relation``), id and role."""

    kind: str
    ref: int
    role: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Relation:
    """Lanelet, area or regulatory element: its members in order, and its tags."""

    members: tuple[Member, ...]
    tags: Tags

    def refs(self, role: str, kind: str) -> tuple[int, ...]:
        """Return the ids of the members with a role and kind, in order."""
        return tuple(m.ref for m in self.members if m.role == role and m.kind == kind)


@dataclass(frozen=True, kw_only=True, eq=False)
class MapFile:
    """Contents of one map file, elements by id.

    Attributes:
        notes: one sentence for each kind of defect; empty if Lanelet2 reads the file unchanged.
        unread: ids of broken lanelets of the file.
        local: whether nodes have local coordinates in m, projected from 0, 0.
    """

    path: Path
    nodes: dict[int, MapPoint] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: dict[int, Relation] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()
    local: bool = False

    @property
    def middle(self) -> tuple[float, float]:
        """Median latitude and longitude of the nodes; raises `MapError` without any."""
        if not self.nodes:
            raise MapError(f"{self.path}: no usable nodes, so no map; name a Lanelet2 .osm file")
        nodes = self.nodes.values()
        return statistics.median(n.lat for n in nodes), statistics.median(n.lon for n in nodes)

    def of_type(self, kind: str) -> dict[int, Relation]:
        """Return the relations whose ``type`` tag is ``kind``, by ascending id."""
        return {i: r for i, r in sorted(self.relations.items()) if r.tags.get("type") == kind}


def list_ids(ids: Iterable[int | str]) -> str:
    """Write ids for a message: the first five, then the number of the others."""
    return listed(sorted(set(ids), key=lambda i: (isinstance(i, str), i)))


@dataclass(kw_only=True, eq=False)
class Findings:
    """Defects of a map: ids of elements by the sentence that says what is wrong with them."""

    ids_by_sentence: dict[str, set[int | str]] = field(default_factory=dict)

    def note(self, sentence: str, *ids: int | str) -> None:
        """Add elements to a sentence; without elements nothing is noted."""
        if ids:
            self.ids_by_sentence.setdefault(sentence, set()).update(ids)

    def notes(self) -> tuple[str, ...]:
        """Return one note for each sentence, naming ids."""
        return tuple(f"{sentence}: {list_ids(ids)}" for sentence, ids in self.ids_by_sentence.items())


def read_map_file(path: str | Path) -> MapFile:
    """Read the elements of an ``.osm`` or ``.osm.gz`` file, without deleted ones.

    Of elements with one id the first is kept; elements without an id or a place on Earth are noted. If most
    nodes have ``local_x`` and ``local_y``, these are the coordinates, as in Autoware.
    """
    path = Path(path)
    elements: dict[str, dict[int, Any]] = {"node": {}, "way": {}, "relation": {}}
    findings, unread = Findings(), list[str]()
    root = xml_root(path, remedy="name a Lanelet2 .osm file")
    if root.tag != "osm":
        raise MapError(f"{path}: no Lanelet2 map: its root is <{root.tag}>, not <osm>; name an .osm file")
    all_nodes = root.findall("node")
    local = 2 * sum({"local_x", "local_y"} <= _tags(node).keys() for node in all_nodes) > len(all_nodes)
    for element in root:
        tag, is_new = element.tag, False
        if element.get("action") == "delete" or tag not in elements:
            continue
        name = f"{tag} {element.get('id', '')[:24] or 'without an id'}"
        try:
            primitive, number = _element(element, local), _id(element, "id")
            is_new = elements[tag].setdefault(number, primitive) is primitive
            if tag == "node" and _height_m(element) is None:
                findings.note("nodes with a height that is no number, height 0 used", name)
            if not is_new:
                findings.note("ids used twice, the first element kept", name)
        except ValueError:
            findings.note("left out, no usable id or coordinates", name)
        if not is_new and tag == "relation" and _tags(element).get("type") == "lanelet":
            unread.append(name.removeprefix("relation "))
    nodes: dict[int, MapPoint] = elements["node"]
    if local and nodes:
        from scex_sumo.converters.lanelet.projection import to_degrees

        places = to_degrees(np.array([(n.lon, n.lat) for n in nodes.values()]), (0.0, 0.0)).tolist()
        for (i, node), (lat, lon) in zip(nodes.items(), places, strict=True):
            nodes[i] = replace(node, lat=lat, lon=lon)
    if not nodes and any(element.get("x") for element in root.iter("node")):
        remedy = "name the .osm file it was made from"
        raise MapError(f"{path}: its nodes have x, y instead of lat, lon; {remedy}")
    local_note = ("coordinates are those of the tags local_x and local_y",) if local else ()
    return MapFile(
        path=path,
        nodes=nodes,
        ways=elements["way"],
        relations=elements["relation"],
        notes=(*local_note, *findings.notes()),
        unread=tuple(unread),
        local=local,
    )


def _element(element: ElementTree.Element, local: bool) -> MapPoint | Way | Relation:
    if element.tag == "node":
        return _node(element, local)
    if element.tag == "way":
        return Way(nodes=tuple(_id(nd, "ref") for nd in element.findall("nd")), tags=_tags(element))
    members = tuple(
        Member(kind=m.get("type", ""), ref=_id(m, "ref"), role=m.get("role", ""))
        for m in element.findall("member")
        if m.get("type") in ("node", "way", "relation")
    )
    return Relation(members=members, tags=_tags(element))


def _id(element: ElementTree.Element, attribute: str) -> int:
    text = element.get(attribute, "").strip()
    number = int(text) if _ID.fullmatch(text) else 0
    if not 0 < abs(number) <= MAX_ID:  # Lanelet2 takes 0 for "no id yet"
        raise ValueError(text)
    return number


def free_ids(used: Iterable[int]) -> Iterator[int]:
    """Yield new ids: above the used ones, or from 1 on if those are near the limit of 64 bits."""
    taken = set(map(abs, used))
    highest = max(taken, default=0)
    return (i for i in count(1 if highest > MAX_ID // 2 else highest + 1) if i not in taken)


def _tags(element: ElementTree.Element) -> Tags:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}


def _node(element: ElementTree.Element, local: bool) -> MapPoint:
    tags = _tags(element)
    limits = _LOCAL if local else _EARTH
    lat, lon = (float(tags.get(key, "") if local else element.get(key, "")) for key in limits)
    if not all(abs(value) <= limit for value, limit in zip((lat, lon), limits.values(), strict=True)):
        raise ValueError("no place")  # nan, too
    return MapPoint(lat=lat, lon=lon, ele=_height_m(element) or 0.0)


def _height_m(node: ElementTree.Element) -> float | None:
    word = next((tag.get("v", "") for tag in node.findall("tag") if tag.get("k") == "ele"), "0")
    try:
        return height if abs(height := float(word)) < MAX_HEIGHT_M else None  # nan fails too
    except ValueError:
        return None


def write_map_file(map_file: MapFile, path: Path) -> None:
    """Write a map for Lanelet2, elements by ascending id."""
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' generator='scex-sumo'>"]
    for i, node in sorted(map_file.nodes.items()):
        lines.append(f"<node id='{i}' lat='{node.lat!r}' lon='{node.lon!r}'>")
        lines.append(f"<tag k='ele' v='{node.ele!r}'/></node>")
    for i, way in sorted(map_file.ways.items()):
        lines.append(f"<way id='{i}'>")
        lines += [f"<nd ref='{node}'/>" for node in way.nodes]
        lines += [*_tag_lines(way.tags), "</way>"]
    for i, relation in sorted(map_file.relations.items()):
        lines.append(f"<relation id='{i}'>")
        lines += [f"<member type='{m.kind}' ref='{m.ref}' role={quoted(m.role)}/>" for m in relation.members]
        lines += [*_tag_lines(relation.tags), "</relation>"]
    path.write_text("\n".join([*lines, "</osm>\n"]), encoding="utf-8")


def _tag_lines(tags: Tags) -> list[str]:
    return [f"<tag k={quoted(key)} v={quoted(value)}/>" for key, value in tags.items()]
