"""Small Lanelet2 maps drawn by hand, in metres, for tests.

A map is drawn around latitude 0, longitude 0, so that ``read_road`` gives back the coordinates drawn here
(to 1e-6 m). Lanelets connect as Lanelet2 wants it: equal coordinates are one node, equal polylines (in
either direction) one way.

    write_map(tmp_path / "two.osm", [
        Lanelet(1, left=[(0, 3), (50, 3)], right=[(0, 0), (50, 0)]),
        Lanelet(2, left=[(50, 3), (90, 3)], right=[(50, 0), (90, 0)]),
    ])
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

from lanelet2.core import BasicPoint3d
from lanelet2.io import Origin
from lanelet2.projection import UtmProjector

Point = Sequence[float]  # (x, y) or (x, y, elevation), m
SOLID = {"type": "line_thin", "subtype": "solid"}
DASHED = {"type": "line_thin", "subtype": "dashed"}
CURB = {"type": "curbstone", "subtype": "low"}
ROAD = {"subtype": "road", "location": "urban", "one_way": "yes", "region": "de"}


@dataclass(frozen=True)
class Lanelet:
    """A lanelet: its bounds in driving direction, the tags of its lines, the rules it names."""

    lanelet_id: int
    left: Sequence[Point]
    right: Sequence[Point]
    tags: Mapping[str, str] = field(default_factory=lambda: ROAD)
    left_tags: Mapping[str, str] = field(default_factory=lambda: SOLID)
    right_tags: Mapping[str, str] = field(default_factory=lambda: SOLID)
    rules: Sequence[int] = ()


@dataclass(frozen=True)
class Line:
    """A line by itself: a stop line, sign, light, marking or part of an area's outline."""

    line_id: int
    points: Sequence[Point]
    tags: Mapping[str, str] = field(default_factory=lambda: {"type": "stop_line"})


@dataclass(frozen=True)
class Relation:
    """A regulatory element or area: members as (role, id); ids of lines are ways, others relations."""

    relation_id: int
    members: Sequence[tuple[str, int]]
    tags: Mapping[str, str]


def rule(relation_id: int, subtype: str, members: Sequence[tuple[str, int]] = (), **tags: str) -> Relation:
    """A regulatory element, e.g. ``rule(90, "right_of_way", [("yield", 1), ("right_of_way", 2)])``."""
    return Relation(relation_id, members, {"type": "regulatory_element", "subtype": subtype, **tags})


def area(relation_id: int, outer: Sequence[int], subtype: str) -> Relation:
    """An area with lines as its outline."""
    return Relation(relation_id, [("outer", i) for i in outer], {"type": "multipolygon", "subtype": subtype})


class _Drawing:
    """Nodes and ways under way; ids from 100 000 on are the drawing's own."""

    def __init__(self) -> None:
        self.projector = UtmProjector(Origin(0.0, 0.0))
        self.nodes: dict[tuple[float, ...], int] = {}
        self.ways: dict[tuple[int, ...], int] = {}
        self.text: list[str] = []

    def node(self, point: Point) -> int:
        x, y, z = (*point, 0.0)[:3]
        key = (round(x, 6), round(y, 6), round(z, 6))
        if key not in self.nodes:
            self.nodes[key] = 100_000 + len(self.nodes)
            place = self.projector.reverse(BasicPoint3d(x, y, z))
            tag = f"<tag k='ele' v='{z!r}'/>" if z else ""
            self.text.append(
                f"<node id='{self.nodes[key]}' lat='{place.lat!r}' lon='{place.lon!r}'>{tag}</node>"
            )
        return self.nodes[key]

    def way(self, points: Sequence[Point], tags: Mapping[str, str], way_id: int | None = None) -> int:
        nodes = tuple(self.node(point) for point in points)
        known = self.ways.get(nodes, self.ways.get(nodes[::-1]))
        if known is not None and way_id is None:
            return known
        way_id = way_id if way_id is not None else 200_000 + len(self.ways)
        self.ways[nodes] = way_id
        refs = "".join(f"<nd ref='{node}'/>" for node in nodes)
        self.text.append(f"<way id='{way_id}'>{refs}{_tags(tags)}</way>")
        return way_id

    def relation(
        self, relation_id: int, members: Sequence[tuple[str, str, int]], tags: Mapping[str, str]
    ) -> None:
        body = "".join(f"<member type='{kind}' ref='{ref}' role='{role}'/>" for role, kind, ref in members)
        self.text.append(f"<relation id='{relation_id}'>{body}{_tags(tags)}</relation>")


def _tags(tags: Mapping[str, str]) -> str:
    return "".join(f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in tags.items())


def draw_map(
    lanelets: Sequence[Lanelet], *, lines: Sequence[Line] = (), relations: Sequence[Relation] = ()
) -> str:
    """The text of an ``.osm`` file."""
    drawing = _Drawing()
    for line in lines:
        drawing.way(line.points, line.tags, line.line_id)
    line_ids = {line.line_id for line in lines}
    for lanelet in lanelets:
        sides = (("left", lanelet.left, lanelet.left_tags), ("right", lanelet.right, lanelet.right_tags))
        members = [(side, "way", drawing.way(points, tags)) for side, points, tags in sides]
        members += [("regulatory_element", "relation", i) for i in lanelet.rules]
        drawing.relation(lanelet.lanelet_id, members, {"type": "lanelet", **lanelet.tags})
    for relation in relations:
        kinds = [(role, "way" if i in line_ids else "relation", i) for role, i in relation.members]
        drawing.relation(relation.relation_id, kinds, relation.tags)
    return "\n".join(
        ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6'>", *drawing.text, "</osm>"]
    )


def write_map(
    path: Path, lanelets: Sequence[Lanelet], *, lines: Sequence[Line] = (), relations: Sequence[Relation] = ()
) -> Path:
    """Write a map to a file; returns its path."""
    path.write_text(draw_map(lanelets, lines=lines, relations=relations), encoding="utf-8")
    return path


def straight(
    lanelet_id: int, start: float, end: float, y: float = 0.0, width: float = 3.5, **other: object
) -> Lanelet:
    """A lanelet along +x from ``start`` to ``end``; ``y`` is its right bound."""
    left, right = [(start, y + width), (end, y + width)], [(start, y), (end, y)]
    return Lanelet(lanelet_id, left=left, right=right, **other)  # type: ignore[arg-type]
