"""Drawing of Lanelet2 maps: lines, lanelets that share them, rules, and the OSM file.

Neighbouring lanelets share the line between them and successive ones share their end nodes, so that
Lanelet2's routing graph finds successors, neighbours and lane changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from example_maps.curves import Curve, Pose, join, smooth_step, stations
from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.projection import to_degrees

NODE_TOLERANCE_M = 0.005
CURB = ("curbstone", "low")
DASHED = ("line_thin", "dashed")
SOLID = ("line_thin", "solid")
VIRTUAL = ("virtual", "")
Mark = tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """One way of the map, points (P, 2) in m."""

    line_id: int
    points: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Lanelet:
    """One lanelet of the map, with the poses of its centre at both ends.

    Attributes:
        outline: (N, 2) m, closed polygon without the repeated first point.
    """

    lanelet_id: int
    left: Line
    right: Line
    start: Pose
    end: Pose
    start_width_m: float
    end_width_m: float
    outline: FloatArray


@dataclass
class _Relation:
    tags: dict[str, str]
    members: list[tuple[str, int, str]] = field(default_factory=list)


class MapDrawing:
    """Lanelet2 map in the making; ids follow the order of drawing, as in INTERACTION's maps."""

    def __init__(self) -> None:
        self._nodes: list[tuple[float, float]] = []
        self._grid: dict[tuple[int, int], list[int]] = {}
        self._ways: dict[int, tuple[list[int], Mark]] = {}
        self._relations: dict[int, _Relation] = {}
        self._rules = 0

    def line(self, points: FloatArray, mark: Mark) -> Line:
        """Add a way of points (P, 2) in m; an empty subtype of its mark is left out."""
        line_id = 10000 + len(self._ways)
        self._ways[line_id] = ([self._node(float(x), float(y)) for x, y in points], mark)
        return Line(line_id=line_id, points=points)

    def lanelet(self, left: Line, right: Line, *, curvature: tuple[float, float], **tags: str) -> Lanelet:
        """Add a lanelet between two lines that both run in driving direction.

        Args:
            curvature: of the centre at the start and at the end, 1/m.
            **tags: in addition to, or in place of, those of an urban road for cars.
        """
        base = {
            "location": "urban",
            "one_way": "yes",
            "region": "de-bw",
            "subtype": "road",
            "type": "lanelet",
        }
        relation = _Relation(tags={**base, **tags})
        relation.members = [("way", left.line_id, "left"), ("way", right.line_id, "right")]
        lanelet_id = self._add(relation, 30000)
        start, start_width = _gate(left.points[0], right.points[0], curvature[0])
        end, end_width = _gate(left.points[-1], right.points[-1], curvature[1])
        return Lanelet(
            lanelet_id=lanelet_id,
            left=left,
            right=right,
            start=start,
            end=end,
            start_width_m=start_width,
            end_width_m=end_width,
            outline=np.concatenate([left.points, right.points[::-1]]),
        )

    def strip(
        self,
        curve: Curve,
        offsets: Sequence[FloatArray | float],
        marks: Sequence[Mark],
        directions: Sequence[int],
        **tags: str,
    ) -> list[Lanelet]:
        """Add lanelets side by side along a curve; neighbours share the line between them.

        Args:
            curve: sampled as it shall be drawn.
            offsets: K lateral positions of the lines, from left to right, m to the left of the curve; an
                array (N,) for a line that moves sideways (flat at both ends).
            marks: K markings.
            directions: K − 1; +1 along the curve, −1 against it, 0 no lanelet (an island).
            **tags: of every lanelet.

        Returns:
            The lanelets from left to right, without islands.
        """
        lines = [self.line(curve.offset(d), m) for d, m in zip(offsets, marks, strict=True)]
        ends = curve.curvature[[0, -1]]
        lanes = []
        for i, direction in enumerate(directions):
            shift = [float(np.broadcast_to(offsets[i], curve.x.shape)[k]) for k in (0, -1)]
            shift = [
                (a + float(np.broadcast_to(offsets[i + 1], curve.x.shape)[k])) / 2
                for a, k in zip(shift, (0, -1), strict=True)
            ]
            kappa = [float(k / (1 - d * k)) for k, d in zip(ends, shift, strict=True)]
            if direction > 0:
                lanes.append(self.lanelet(lines[i], lines[i + 1], curvature=(kappa[0], kappa[1]), **tags))
            elif direction < 0:
                left, right = reversed_line(lines[i + 1]), reversed_line(lines[i])
                lanes.append(self.lanelet(left, right, curvature=(-kappa[1], -kappa[0]), **tags))
        return lanes

    def connect(
        self,
        first: Lanelet,
        second: Lanelet,
        left: Mark | Line = VIRTUAL,
        right: Mark | Line = VIRTUAL,
        **tags: str,
    ) -> Lanelet:
        """Add a lanelet from the end of one to the start of another, smooth in direction and curvature.

        Args:
            left: marking of the left bound, or the line of another lanelet.
            right: the same on the right.
        """
        curve = join(first.end, second.start)
        count = stations(curve.length, float(np.abs(curve.curvature).max()))
        curve = curve.at(np.linspace(0.0, curve.length, count))
        half = first.end_width_m + (second.start_width_m - first.end_width_m) * smooth_step(
            curve.s, 0.0, curve.length
        )
        bounds = [
            mark if isinstance(mark, Line) else self.line(curve.offset(side * half / 2), mark)
            for side, mark in ((1, left), (-1, right))
        ]
        ends = (first.end.curvature, second.start.curvature)
        return self.lanelet(bounds[0], bounds[1], curvature=ends, **tags)

    def speed_limit(self, lanelets: Sequence[Lanelet], limit_kmh: int) -> None:
        """Add one speed limit for all the lanelets."""
        self._rule(_Relation(tags={"sign_type": f"{limit_kmh}kmh", "subtype": "speed_limit"}), lanelets)

    def right_of_way(self, yielding: Sequence[Lanelet], priority: Sequence[Lanelet], at: Line | None) -> None:
        """Add a right of way with its yielding and its priority lanelets, and the line to wait at."""
        relation = _Relation(tags={"subtype": "right_of_way"})
        if at is not None:
            relation.members.append(("way", at.line_id, "ref_line"))
        relation.members += [("relation", lane.lanelet_id, "right_of_way") for lane in priority]
        relation.members += [("relation", lane.lanelet_id, "yield") for lane in yielding]
        self._rule(relation, [*yielding, *priority])

    def area(self, outline: Sequence[Line], subtype: str) -> None:
        """Add an area with an outline of lines in order, each in either direction."""
        members = [("way", line.line_id, "outer") for line in outline]
        self._add(
            _Relation(
                tags={"location": "urban", "subtype": subtype, "type": "multipolygon"}, members=members
            ),
            30000,
        )

    def write(self, path: Path) -> None:
        """Write the map; equal drawings give equal bytes."""
        rows = ['<?xml version="1.0"?>', '<osm version="0.6" generator="scex-sumo">']
        # As in INTERACTION: projected with 0, 0 the map has the tracks' own x and y.
        for i, (lat, lon) in enumerate(to_degrees(np.array(self._nodes), (0.0, 0.0))):
            rows.append(
                f'  <node id="{1000 + i}" visible="true" version="1" lat="{lat:.11f}" lon="{lon:.11f}" />'
            )
        for way_id, (nodes, (kind, subtype)) in self._ways.items():
            rows.append(f'  <way id="{way_id}" visible="true" version="1">')
            rows += [f'    <nd ref="{1000 + node}" />' for node in nodes]
            rows += _tags({"subtype": subtype, "type": kind} if subtype else {"type": kind})
            rows.append("  </way>")
        for relation_id, relation in sorted(self._relations.items()):
            rows.append(f'  <relation id="{relation_id}" visible="true" version="1">')
            rows += [
                f'    <member type="{t}" ref="{ref}" role="{role}" />' for t, ref, role in relation.members
            ]
            rows += [*_tags(relation.tags), "  </relation>"]
        path.write_text("\n".join([*rows, "</osm>", ""]), encoding="utf-8")

    def _node(self, x: float, y: float) -> int:
        column, row = round(x / NODE_TOLERANCE_M), round(y / NODE_TOLERANCE_M)
        for i in (0, -1, 1):
            for j in (0, -1, 1):
                for node in self._grid.get((column + i, row + j), []):
                    other = self._nodes[node]
                    if np.hypot(x - other[0], y - other[1]) < NODE_TOLERANCE_M:
                        return node
        self._nodes.append((x, y))
        self._grid.setdefault((column, row), []).append(len(self._nodes) - 1)
        return len(self._nodes) - 1

    def _add(self, relation: _Relation, base: int) -> int:
        relation_id = base + len(self._relations) - self._rules
        self._relations[relation_id] = relation
        return relation_id

    def _rule(self, relation: _Relation, lanelets: Sequence[Lanelet]) -> None:
        relation.tags["type"] = "regulatory_element"
        rule_id = 50000 + self._rules
        self._relations[rule_id] = relation
        self._rules += 1
        for lane in lanelets:
            self._relations[lane.lanelet_id].members.append(("relation", rule_id, "regulatory_element"))


def reversed_line(line: Line) -> Line:
    """Return the same way of the map, seen from its other end."""
    return Line(line_id=line.line_id, points=line.points[::-1])


def _gate(left: FloatArray, right: FloatArray, curvature: float) -> tuple[Pose, float]:
    centre, across = (left + right) / 2, left - right
    heading = float(np.arctan2(across[1], across[0]) - np.pi / 2)
    pose = Pose(x=float(centre[0]), y=float(centre[1]), heading=heading, curvature=curvature)
    return pose, float(np.hypot(*across))


def _tags(tags: dict[str, str]) -> list[str]:
    return [f"    <tag k={quoteattr(k)} v={quoteattr(v)} />" for k, v in sorted(tags.items())]
