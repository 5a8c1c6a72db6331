"""Lanes of a road and their boundaries as OSI ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

from scex_sumo.base.arrays import FloatArray
from scex_sumo.exporters.opendrive.file import OpenDrive
from scex_sumo.exporters.opendrive.network import lane_groups
from scex_sumo.exporters.opendrive.reference import Group, borders
from scex_sumo.road import Lane, Road

_DRIVING, _NONDRIVING, _INTERSECTION = 2, 3, 4
_SUBTYPES = {"vehicle": 2, "bus": 2, "bicycle": 3, "pedestrian": 4}
_RESTRICTED = 7  # OSI's subtype of other lanes
_NO_LINE, _SOLID, _DASHED = 2, 3, 4
SOURCE = "net.asam.opendrive"


def reference(identifiers: Iterable[str], betterosi: Any) -> list[Any]:
    """Return the reference to an item of the trace's OpenDRIVE map."""
    return [betterosi.ExternalReference(type=SOURCE, identifier=list(identifiers))]


def static_map(
    road: Road, drawn: OpenDrive, numbers: Mapping[int, int], free: Iterator[int], betterosi: Any
) -> dict[str, list[Any]]:
    """Return the lanes and boundaries, by numbers of lanes and ``free`` ones: OSI has one range for all."""
    parts: dict[str, list[Any]] = {"lane": [], "lane_boundary": []}
    for group in lane_groups(road.lanes):
        sides = []
        for k, line in enumerate(borders(road.lanes, group)):
            sides.append(next(free))
            is_crossed = _is_crossed(road.lanes, group, k)
            kind = _NO_LINE if group[0] in drawn.inside else _DASHED if is_crossed else _SOLID
            parts["lane_boundary"].append(_boundary(sides[-1], line, kind, betterosi))
        for n in range(len(group)):
            lane = _lane(road, group, n, sides[n : n + 2], drawn, numbers, betterosi)
            parts["lane"].append(lane)
    return parts


def _points(line: FloatArray, betterosi: Any) -> list[Any]:
    return [betterosi.Vector3d(x=x, y=y, z=0.0) for x, y in line.tolist()]


def _boundary(number: int, line: FloatArray, drawn: int, betterosi: Any) -> Any:
    kind = betterosi.LaneBoundary
    return kind(
        id=betterosi.Identifier(value=number),
        boundary_line=[kind.BoundaryPoint(position=place) for place in _points(line, betterosi)],
        classification=kind.Classification(type=kind.Classification.Type(drawn)),
    )


def _lane(
    road: Road,
    group: Group,
    n: int,
    sides: Sequence[int],
    drawn: OpenDrive,
    numbers: Mapping[int, int],
    betterosi: Any,
) -> Any:
    """Return the n-th lane of a group; ``sides`` are the numbers of its boundaries."""
    lane, kind, identifier = road.lanes[group[n]], betterosi.Lane.Classification, betterosi.Identifier
    i, driven = lane.lane_id, _INTERSECTION if group[n] in drawn.inside else _DRIVING
    ends = [
        [identifier(value=numbers[j]) for j in others if j in numbers] or [None]
        for others in (lane.predecessors, lane.successors)
    ]
    return betterosi.Lane(
        id=identifier(value=numbers[i]),
        classification=kind(
            type=kind.Type(driven if lane.kind in ("vehicle", "bus") else _NONDRIVING),
            subtype=kind.Subtype(_SUBTYPES.get(lane.kind, _RESTRICTED)),
            centerline=_points(lane.centreline, betterosi),
            centerline_is_driving_direction=True,
            left_adjacent_lane_id=[identifier(value=numbers[j]) for j in group[n - 1 : n]],
            right_adjacent_lane_id=[identifier(value=numbers[j]) for j in group[n + 1 : n + 2]],
            lane_pairing=[
                kind.LanePairing(antecessor_lane_id=before, successor_lane_id=after)
                for before, after in product(*ends)
            ],
            left_lane_boundary_id=[identifier(value=sides[0])],
            right_lane_boundary_id=[identifier(value=sides[1])],
        ),
        source_reference=reference(drawn.places[i], betterosi) if i in drawn.places else [],
    )


def _is_crossed(lanes: Mapping[int, Lane], group: Group, k: int) -> bool:
    """Return whether a vehicle may change lanes over the k-th border of a group, leftmost first."""
    if not 0 < k < len(group):
        return False
    return lanes[group[k - 1]].right is not None or lanes[group[k]].left is not None
