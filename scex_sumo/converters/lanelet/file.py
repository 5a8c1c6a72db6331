"""Lanelet2 map as it stands in its file: nodes, ways and relations, before Lanelet2 reads them.

Lanelet2 drops what it cannot use without a word, or crashes on it. What a map really says, and what is
broken in it, is found here with the standard library alone.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

from scex_sumo.converters.formats import open_binary
from scex_sumo.errors import MapError, listed
from scex_sumo.files import quoted

Tags = Mapping[str, str]
_ID = re.compile(r"-?[0-9]{1,18}")  # what fits Lanelet2's 64 bit ids
HIGHEST_M = 10_000.0  # no road lies higher
_EARTH = {"lat": 90.0, "lon": 180.0}
_Element = TypeVar("_Element")


@dataclass(frozen=True, kw_only=True, slots=True)
class MapPoint:
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
        notes: what could not be read, one short sentence each; empty where Lanelet2 reads the file alike.
    """

    path: Path
    nodes: dict[int, MapPoint] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: dict[int, Relation] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def of_type(self, kind: str) -> dict[int, Relation]:
        """Relations whose ``type`` tag is ``kind``, by ascending id."""
        found = {i: r for i, r in self.relations.items() if r.tags.get("type") == kind}
        return dict(sorted(found.items()))


def list_ids(ids: Iterable[int | str]) -> str:
    """Write ids for a message: the first few, then how many more there are."""
    return listed(sorted(set(ids), key=lambda i: (isinstance(i, str), i)))


def parse_xml(path: Path, kind: str, ending: str) -> ElementTree.Element:
    """Root of a map's XML, which may be packed.

    Args:
        path: the file.
        kind: of map that is wanted, in words.
        ending: of the names of such files.

    Raises:
        MapError: the file is missing, is no file, or is not XML.
    """
    if path.is_dir():
        raise MapError(f"{path}: is a folder; name the {ending} file in it")
    if not path.is_file():
        raise MapError(f"{path}: no such map; name a {kind} {ending} file")
    try:
        with open_binary(path) as file:
            return ElementTree.parse(file).getroot()
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise MapError(f"{path}: cannot be unpacked ({error}); fetch the file again") from None
    except ElementTree.ParseError as error:
        raise MapError(f"{path}: not XML ({error}); name a {kind} {ending} file") from None
    except (OSError, ValueError, LookupError) as error:
        raise MapError(f"{path}: cannot be read ({error}); name a {kind} {ending} file") from None


@dataclass(kw_only=True, eq=False)
class Findings:
    """What was found in a map: ids of elements by sentence, which they follow in a note."""

    found: dict[str, set[int | str]] = field(default_factory=dict)

    def note(self, sentence: str, *ids: int | str) -> None:
        """Remember what was found about some elements, if any."""
        if ids:
            self.found.setdefault(sentence, set()).update(ids)

    def notes(self) -> tuple[str, ...]:
        """One short sentence for each thing found, naming ids."""
        return tuple(f"{sentence}: {list_ids(ids)}" for sentence, ids in self.found.items())


def read_map_file(path: str | Path) -> MapFile:
    """Read a map file's elements; what is marked as deleted is left out, as Lanelet2 does.

    Of elements with one id the first is kept. Elements without an id or with coordinates that are no place
    on Earth are left out; both is noted.

    Args:
        path: an ``.osm`` file, or one packed as ``.osm.gz``.

    Raises:
        MapError: the file is missing, is no file, is not XML, or is not an OSM file.
    """
    path = Path(path)
    nodes: dict[int, MapPoint] = {}
    ways: dict[int, Way] = {}
    relations: dict[int, Relation] = {}
    findings = Findings()
    root = parse_xml(path, "Lanelet2", ".osm")
    if root.tag != "osm":
        raise MapError(f"{path}: no Lanelet2 map: its root is <{root.tag}>, not <osm>; name an .osm file")
    for element in root:
        if element.get("action") == "delete":
            continue
        name = f"{element.tag} {element.get('id', '')[:24] or 'without an id'}"
        try:
            if element.tag == "node":
                new = _put(nodes, _id(element, "id"), _node(element))
                if _height_m(element) is None:
                    findings.note("heights not understood, taken for 0", name)
            elif element.tag == "way":
                new = _put(ways, _id(element, "id"), Way(nodes=_way_nodes(element), tags=_tags(element)))
            elif element.tag == "relation":
                relation = Relation(members=_members(element), tags=_tags(element))
                new = _put(relations, _id(element, "id"), relation)
            else:
                continue
        except ValueError:
            findings.note("left out, no usable id or coordinates", name)
            continue
        if not new:
            findings.note("ids used twice, the first element kept", name)
    if not nodes and any(element.get("x") for element in root.iter("node")):
        raise MapError(
            f"{path}: its nodes have x, y instead of lat, lon; name the .osm file it was made from"
        )
    return MapFile(path=path, nodes=nodes, ways=ways, relations=relations, notes=findings.notes())


def write_map_file(map_file: MapFile, path: Path) -> None:
    """Write a map in a form that Lanelet2 reads as it stands here, ascending ids."""
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


def _put(elements: dict[int, _Element], element_id: int, element: _Element) -> bool:
    """Add an element unless its id is taken."""
    return elements.setdefault(element_id, element) is element


def _id(element: ElementTree.Element, attribute: str) -> int:
    text = element.get(attribute, "").strip()
    if not _ID.fullmatch(text) or int(text) == 0:  # Lanelet2 takes 0 for "no id yet"
        raise ValueError(text)
    return int(text)


def _tags(element: ElementTree.Element) -> Tags:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}


def _node(element: ElementTree.Element) -> MapPoint:
    place = {key: float(element.get(key, "")) for key in _EARTH}
    if not all(abs(place[key]) <= limit for key, limit in _EARTH.items()):  # nan fails too
        raise ValueError("no place on Earth")
    return MapPoint(**place, ele=_height_m(element) or 0.0)


def _height_m(node: ElementTree.Element) -> float | None:
    """Height of a node, 0 where none is given, None where it is none that a road has."""
    word = next((tag.get("v", "") for tag in node.findall("tag") if tag.get("k") == "ele"), "0")
    try:
        return height if abs(height := float(word)) < HIGHEST_M else None  # nan fails too
    except ValueError:
        return None


def _way_nodes(element: ElementTree.Element) -> tuple[int, ...]:
    return tuple(_id(nd, "ref") for nd in element.findall("nd"))


def _members(element: ElementTree.Element) -> tuple[Member, ...]:
    members = element.findall("member")
    kinds = ("node", "way", "relation")
    return tuple(
        Member(kind=m.get("type", ""), ref=_id(m, "ref"), role=m.get("role", ""))
        for m in members
        if m.get("type") in kinds
    )
