"""The road as arrays: lanes, neighbours, right of way. No lanelet2 or sumolib types.

A *lane* here is one Lanelet2 lanelet, in driving direction; SUMO's lanes are named ``sumo_lane``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from scex_sumo.arrays import FloatArray
from scex_sumo.errors import listed


@dataclass(frozen=True, kw_only=True, eq=False)
class Lane:
    """One lanelet, in driving direction.

    Attributes:
        lane_id: the lanelet's id.
        centreline: (P, 2) m.
        left_bound: (L, 2) m, in driving direction.
        right_bound: (R, 2) m, in driving direction.
        width_m: mean distance of the bounds.
        speed_limit_mps: limit for cars.
        kind: ``vehicle`` (cars may drive here), ``bus``, ``bicycle``, ``pedestrian`` or ``other``.
        subtype: Lanelet2's subtype as written, e.g. ``road``, or an empty string; ``road`` where an unknown
            one is taken for it.
        location: ``urban``, ``nonurban`` or an empty string.
        successors: lanes that a vehicle enters at the end (vehicle routing graph).
        predecessors: the reverse of ``successors``.
        left: lane that a vehicle may change to on the left, or None.
        right: lane that a vehicle may change to on the right, or None.
        adjacent_left: neighbour on the left in the same direction, changing allowed or not.
        adjacent_right: neighbour on the right in the same direction, changing allowed or not.
        conflicts: vehicle lanes whose area overlaps this one's (Lanelet2's conflicting).
        reverse_of: the lanelet whose opposite direction this lane is, where cars drive a lanelet both ways;
            then ``lane_id`` is no id of the map. None for all other lanes.
    """

    lane_id: int
    centreline: FloatArray
    left_bound: FloatArray
    right_bound: FloatArray
    width_m: float
    speed_limit_mps: float
    kind: str = "vehicle"
    subtype: str = ""
    location: str = ""
    successors: tuple[int, ...] = ()
    predecessors: tuple[int, ...] = ()
    left: int | None = None
    right: int | None = None
    adjacent_left: int | None = None
    adjacent_right: int | None = None
    conflicts: tuple[int, ...] = ()
    reverse_of: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Regulation:
    """One regulatory element.

    Attributes:
        element_id: its id in the map.
        kind: ``right_of_way``, ``all_way_stop``, ``traffic_light``, ``stop`` or ``yield``.
        lanes: lanes that refer to it.
        yielding: lanes that must give way (all of them for ``all_way_stop``).
        priority: lanes that have the right of way.
        stop_lines: (S, 2) polylines.
        lights: ids of the traffic light linestrings.
        signs: types of the signs it refers to, as written, e.g. ``de205``, ``usR1-1``.
    """

    element_id: int
    kind: str
    lanes: tuple[int, ...] = ()
    yielding: tuple[int, ...] = ()
    priority: tuple[int, ...] = ()
    stop_lines: tuple[FloatArray, ...] = ()
    lights: tuple[int, ...] = ()
    signs: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Marking:
    """A line on (or beside) the road, for drawing.

    Attributes:
        line_id: id of the linestring.
        kind: Lanelet2 type, e.g. ``line_thin``, ``curbstone``, ``stop_line``, ``pedestrian_marking``.
        subtype: e.g. ``dashed``, ``solid``, or an empty string.
        points: (P, 2) m.
    """

    line_id: int
    kind: str
    subtype: str
    points: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Area:
    """A closed region: crosswalk, walkway, island, keep-out, parking, for drawing."""

    area_id: int
    kind: str
    outline: FloatArray


@dataclass(frozen=True, kw_only=True)
class Loss:
    """Elements of the map that the road does without.

    Attributes:
        kind: ``lanelets``, ``lights`` or ``lane changes``.
        why: what became of them, e.g. ``not driven, subtype main_road``.
        elements: their ids; a lane change is two lanelets with a word between.
    """

    kind: str
    why: str
    elements: tuple[int | str, ...]

    def __str__(self) -> str:
        return f"{len(self.elements)} {self.kind} {self.why}: {listed(self.elements)}"


@dataclass(frozen=True, kw_only=True)
class Georeference:
    """Where a road lies on Earth.

    Attributes:
        projection: in PROJ's words, e.g. ``+proj=utm +zone=32 ...``.
        east_m: what is to be added to x for the projection's easting.
        north_m: what is to be added to y for its northing.
    """

    projection: str
    east_m: float
    north_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Road:
    """All lanes of a map, with the rules between them.

    Attributes:
        name: stem of the map's file name.
        lanes: every usable lanelet by id, of every kind.
        regulations: right of way, stops, lights.
        markings: lines for drawing.
        areas: areas for drawing.
        origin: (latitude, longitude) that the coordinates were projected with.
        georeference: the projection, where it is known and the origin a real place.
        notes: what was repaired or left out, one short sentence each, naming ids.
        losses: what of the map is not there.
        net: the SUMO net that it was read from, to be used as it is; None for maps of other formats.
        file: the map that it was read from, or None where it was made.
    """

    name: str
    lanes: Mapping[int, Lane]
    regulations: tuple[Regulation, ...] = ()
    markings: tuple[Marking, ...] = ()
    areas: tuple[Area, ...] = ()
    origin: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()
    georeference: Georeference | None = None
    net: Path | None = None
    file: Path | None = None

    @property
    def vehicle_lanes(self) -> dict[int, Lane]:
        """The lanes that cars may drive on, by id."""
        return {i: lane for i, lane in self.lanes.items() if lane.kind == "vehicle"}
