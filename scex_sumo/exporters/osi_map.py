"""Lanes of a road as OSI ground truth: physical lanes with boundaries, logical lanes along reference lines.

Lanes side by side share the left border of the leftmost one as reference line.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.exporters.opendrive.file import OpenDrive
from scex_sumo.exporters.opendrive.network import lane_groups
from scex_sumo.exporters.opendrive.reference import Group, borders
from scex_sumo.geometry.polylines import arc_lengths, project
from scex_sumo.road import Lane, Road
from scex_sumo.roads.conflicts import conflicts

_DRIVING, _NONDRIVING, _INTERSECTION = 2, 3, 4
_SUBTYPES = {"vehicle": 2, "bus": 2, "bicycle": 3, "pedestrian": 4}
"""OSI's subtype of a lane and type of a logical lane; other lanes are restricted."""
_RESTRICTED = 7
_NO_LINE, _SOLID, _DASHED = 2, 3, 4
_NONE_ALLOWED, _TO_LEFT, _TO_RIGHT, _BOTH = 2, 3, 4, 5
_WITH_T_AXIS, _FORWARD, _SPEED_LIMIT, _KMH = 1, 2, 0, 3
SOURCE = "net.asam.opendrive"


@dataclass(frozen=True, kw_only=True)
class OsiNumbers:
    """Numbers of a trace, in the one range that OSI has for all its items.

    Attributes:
        lanes: number of each lane of the road.
        free: numbers of nothing yet.
    """

    lanes: Mapping[int, int]
    free: Iterator[int]


def reference(identifiers: Iterable[str], betterosi: Any) -> list[Any]:
    """Return the reference to an item of the trace's OpenDRIVE map."""
    return [betterosi.ExternalReference(type=SOURCE, identifier=list(identifiers))]


def static_map(road: Road, drawn: OpenDrive, numbers: OsiNumbers, betterosi: Any) -> dict[str, list[Any]]:
    """Return the parts of ground truth that do not change: lanes, boundaries, logical lanes."""
    lanes = _Lanes(road, drawn, numbers, betterosi)
    for group in lane_groups(road.lanes):
        lanes.add(group)
    lanes.add_overlaps()
    return lanes.parts


class _Lanes:
    def __init__(self, road: Road, drawn: OpenDrive, numbers: OsiNumbers, betterosi: Any) -> None:
        self.road, self.drawn, self.numbers, self.osi = road, drawn, numbers, betterosi
        self.logical: dict[int, Any] = {i: None for i in road.lanes}
        self.ids = {i: next(numbers.free) for i in road.lanes}
        self.lines: dict[int, FloatArray] = {}
        names = ("lane", "lane_boundary", "reference_line", "logical_lane_boundary", "logical_lane")
        self.parts: dict[str, list[Any]] = {name: [] for name in names}

    def add(self, group: Group) -> None:
        lines = borders(self.road.lanes, group)
        axis = self._reference_line(lines[0])
        rules = [_passing(self.road.lanes, group, k) for k in range(len(lines))]
        physical = [self._boundary(line, group, rule) for line, rule in zip(lines, rules, strict=True)]
        ends = [
            self._logical_boundary(lines[0], axis, *one) for one in zip(lines, physical, rules, strict=True)
        ]
        length = float(arc_lengths(lines[0])[-1])
        for n, i in enumerate(group):
            self.lines[i] = lines[0]
            self.parts["lane"].append(self._lane(i, group, n, physical[n : n + 2]))
            self.logical[i] = self._logical(i, group, n, axis, ends[n : n + 2], length)
            self.parts["logical_lane"].append(self.logical[i])

    def _id(self, number: int) -> Any:
        return self.osi.Identifier(value=number)

    def _points(self, line: FloatArray) -> list[Any]:
        return [self.osi.Vector3d(x=x, y=y, z=0.0) for x, y in line.tolist()]

    def _reference_line(self, line: FloatArray) -> int:
        number, kind = next(self.numbers.free), self.osi.ReferenceLine
        dx, dy = np.gradient(line, axis=0).T
        rows = zip(self._points(line), arc_lengths(line).tolist(), np.arctan2(dy, dx).tolist(), strict=True)
        points = [
            kind.ReferenceLinePoint(world_position=place, s_position=s, t_axis_yaw=yaw + np.pi / 2)
            for place, s, yaw in rows
        ]
        self.parts["reference_line"].append(
            kind(id=self._id(number), type=kind.Type(_WITH_T_AXIS), poly_line=points)
        )
        return number

    def _boundary(self, line: FloatArray, group: Group, rule: int) -> int:
        number, kind = next(self.numbers.free), self.osi.LaneBoundary
        drawn = _NO_LINE if group[0] in self.drawn.inside else _SOLID if rule == _NONE_ALLOWED else _DASHED
        classification = kind.Classification(type=kind.Classification.Type(drawn))
        points = [kind.BoundaryPoint(position=place) for place in self._points(line)]
        self.parts["lane_boundary"].append(
            kind(id=self._id(number), boundary_line=points, classification=classification)
        )
        return number

    def _logical_boundary(
        self, reference_line: FloatArray, axis: int, line: FloatArray, physical: int, rule: int
    ) -> int:
        number, kind = next(self.numbers.free), self.osi.LogicalLaneBoundary
        s, gap = project(line, reference_line)
        rows = zip(self._points(line), np.maximum.accumulate(s).tolist(), gap.tolist(), strict=True)
        self.parts["logical_lane_boundary"].append(
            kind(
                id=self._id(number),
                boundary_line=[
                    kind.LogicalBoundaryPoint(position=place, s_position=at, t_position=-beside)
                    for place, at, beside in rows
                ],
                reference_line_id=self._id(axis),
                physical_boundary_id=[self._id(physical)],
                passing_rule=kind.PassingRule(rule),
            )
        )
        return number

    def _lane(self, i: int, group: Group, n: int, sides: Sequence[int]) -> Any:
        lane, kind, number = self.road.lanes[i], self.osi.Lane.Classification, self.numbers.lanes
        driven = _INTERSECTION if i in self.drawn.inside else _DRIVING
        pairs = product(_known(lane.predecessors, number), _known(lane.successors, number))
        return self.osi.Lane(
            id=self._id(number[i]),
            classification=kind(
                type=kind.Type(driven if lane.kind in ("vehicle", "bus") else _NONDRIVING),
                subtype=kind.Subtype(_SUBTYPES.get(lane.kind, _RESTRICTED)),
                centerline=self._points(lane.centreline),
                centerline_is_driving_direction=True,
                left_adjacent_lane_id=[self._id(number[j]) for j in group[n - 1 : n]],
                right_adjacent_lane_id=[self._id(number[j]) for j in group[n + 1 : n + 2]],
                lane_pairing=[
                    kind.LanePairing(
                        antecessor_lane_id=None if before is None else self._id(before),
                        successor_lane_id=None if after is None else self._id(after),
                    )
                    for before, after in pairs
                ],
                left_lane_boundary_id=[self._id(sides[0])],
                right_lane_boundary_id=[self._id(sides[1])],
            ),
            source_reference=self._source(i),
        )

    def _source(self, i: int) -> list[Any]:
        place = self.drawn.places.get(i)
        return [] if place is None else reference(place, self.osi)

    def _logical(self, i: int, group: Group, n: int, axis: int, sides: Sequence[int], length: float) -> Any:
        lane, kind = self.road.lanes[i], self.osi.LogicalLane

        def beside(others: Group) -> list[Any]:
            spans = {"start_s": 0.0, "end_s": length, "start_s_other": 0.0, "end_s_other": length}
            return [kind.LaneRelation(other_lane_id=self._id(self.ids[j]), **spans) for j in others]

        def joined(others: Sequence[int], *, begins: bool) -> list[Any]:
            return [
                kind.LaneConnection(other_lane_id=self._id(self.ids[j]), at_begin_of_other_lane=begins)
                for j in others
                if j in self.ids
            ]

        limit = self.osi.TrafficSignValue
        rule = kind.TrafficRule
        return kind(
            id=self._id(self.ids[i]),
            type=kind.Type(_SUBTYPES.get(lane.kind, _RESTRICTED)),
            source_reference=self._source(i),
            physical_lane_reference=[
                kind.PhysicalLaneReference(
                    physical_lane_id=self._id(self.numbers.lanes[i]), start_s=0.0, end_s=length
                )
            ],
            reference_line_id=self._id(axis),
            start_s=0.0,
            end_s=length,
            move_direction=kind.MoveDirection(_FORWARD),
            left_adjacent_lane=beside(group[n - 1 : n]),
            right_adjacent_lane=beside(group[n + 1 : n + 2]),
            left_boundary_id=[self._id(sides[0])],
            right_boundary_id=[self._id(sides[1])],
            predecessor_lane=joined(lane.predecessors, begins=False),
            successor_lane=joined(lane.successors, begins=True),
            traffic_rule=[
                rule(
                    traffic_rule_type=rule.TrafficRuleType(_SPEED_LIMIT),
                    speed_limit=rule.SpeedLimit(
                        speed_limit_value=limit(value=3.6 * lane.speed_limit_mps, value_unit=limit.Unit(_KMH))
                    ),
                )
            ],
        )

    def add_overlaps(self) -> None:
        """Tell each logical lane which others cross it, merge with it, or leave it, and where."""
        found: dict[int, list[tuple[float, float, Any]]] = {}
        for one in conflicts(self.road.lanes):
            spans = [self._span(i, span) for i, span in zip(one.lanes, one.spans, strict=True)]
            for k in (0, 1):
                (start, end), (other_start, other_end) = spans[k], spans[1 - k]
                relation = self.osi.LogicalLane.LaneRelation(
                    other_lane_id=self._id(self.ids[one.lanes[1 - k]]),
                    start_s=start,
                    end_s=end,
                    start_s_other=other_start,
                    end_s_other=other_end,
                )
                found.setdefault(one.lanes[k], []).append((start, end, relation))
        for i, relations in found.items():
            ordered = sorted(relations, key=lambda one: one[:2])
            self.logical[i].overlapping_lane = [relation for _, _, relation in ordered]

    def _span(self, i: int, span: tuple[float, float]) -> tuple[float, float]:
        """Return a span of a centreline as a span of the lane's reference line."""
        line = self.road.lanes[i].centreline
        arc = arc_lengths(line)
        places = np.stack([np.interp(span, arc, axis) for axis in line.T], axis=1)
        start, end = project(places, self.lines[i])[0].tolist()
        return min(start, end), max(start, end)


def _known(others: Sequence[int], numbers: Mapping[int, int]) -> list[int | None]:
    return [numbers[j] for j in others if j in numbers] or [None]


def _passing(lanes: Mapping[int, Lane], group: Group, k: int) -> int:
    """Return OSI's rule of changing lanes over the k-th border of a group, leftmost first."""
    if not 0 < k < len(group):
        return _NONE_ALLOWED
    to_right, to_left = lanes[group[k - 1]].right is not None, lanes[group[k]].left is not None
    return {(True, True): _BOTH, (False, True): _TO_LEFT, (True, False): _TO_RIGHT}.get(
        (to_right, to_left), _NONE_ALLOWED
    )
