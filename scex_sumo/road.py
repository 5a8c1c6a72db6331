"""Road as arrays: lanes, neighbours, regulations; no lanelet2 or sumolib types.

A *lane* is one Lanelet2 lanelet in driving direction; SUMO's lanes are named ``sumo_lane``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import listed
from scex_sumo.base.owned import SentOnce, owner_cache


@dataclass(frozen=True, kw_only=True, eq=False)
class Lane:
    """One lanelet, in driving direction.

    Attributes:
        centreline: (P, 2) m; so the bounds.
        width_m: mean distance of the bounds.
        kind: ``vehicle`` (cars may drive here), ``bus``, ``bicycle``, ``pedestrian`` or ``other``.
        subtype: Lanelet2's, e.g. ``road``, or empty.
        location: ``urban``, ``nonurban`` or empty.
        successors: lanes that a vehicle enters at the end.
        left: lane for a lane change to the left, or None.
        adjacent_left: neighbour in the same direction, lane change allowed or not.
        conflicts: vehicle lanes whose area overlaps this one's.
        reverse_of: the lanelet that this lane drives in the opposite direction, else None; then ``lane_id``
            is no id of the map.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> lane = scene.road.lanes[min(scene.road.vehicle_lanes)]
        >>> lane.kind, lane.centreline.shape[1]
        ('vehicle', 2)
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

    @property
    def outline(self) -> FloatArray:
        """(M, 2) of the lane's area: along the left bound, back along the right one."""
        return np.concatenate([self.left_bound, self.right_bound[::-1]])

    @property
    def beside(self) -> tuple[int | None, int | None]:
        """Left and right neighbour in the same direction: the adjacent lane, else that of a lane change."""
        return (
            self.left if self.adjacent_left is None else self.adjacent_left,
            self.right if self.adjacent_right is None else self.adjacent_right,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Regulation:
    """One regulatory element."""

    element_id: int
    kind: str  # ``right_of_way``, ``all_way_stop``, ``traffic_light``, ``stop`` or ``yield``
    lanes: tuple[int, ...] = ()  # that refer to it
    yielding: tuple[int, ...] = ()  # that must give way; all lanes for ``all_way_stop``
    priority: tuple[int, ...] = ()
    stop_lines: tuple[FloatArray, ...] = ()  # (S, 2) polylines, m
    lights: tuple[int, ...] = ()  # ids of the linestrings
    signs: tuple[str, ...] = ()  # types, e.g. ``de205``, ``usR1-1``


@dataclass(frozen=True, kw_only=True, eq=False)
class Marking:
    """A line on or beside the road, for drawing."""

    line_id: int
    kind: str  # Lanelet2 type, e.g. ``line_thin``, ``curbstone``, ``stop_line``
    subtype: str  # e.g. ``dashed``, ``solid``, or empty
    points: FloatArray  # (P, 2) m


@dataclass(frozen=True, kw_only=True, eq=False)
class Area:
    """A closed region for drawing: crosswalk, walkway, island, keep-out, parking."""

    area_id: int
    kind: str
    outline: FloatArray


@dataclass(frozen=True, kw_only=True)
class MapLoss:
    """Elements of the map that the road leaves out."""

    kind: str  # ``lanelets``, ``lights`` or ``lane changes``
    why: str  # e.g. ``not driven, subtype main_road``
    elements: tuple[int | str, ...]  # ids; a lane change is two lanelets with a word between
    of: int = 0  # number of such elements in the map; 0 if unknown

    @property
    def large(self) -> bool:
        """Whether it is more than 1 % of the map's elements of this kind."""
        return len(self.elements) > 0.01 * self.of > 0.0

    @property
    def note(self) -> str:
        """Sentence for the terminal and the page; a warning for a large loss."""
        return f"warning: {self}" if self.large else str(self)

    def __str__(self) -> str:
        number = len(self.elements)
        many = f"{number} of {self.of} {self.kind} ({number / self.of:.0%})" if self.large else ""
        return f"{many or f'{number} {self.kind}'} {self.why}: {listed(self.elements)}"


@dataclass(frozen=True, kw_only=True)
class Georeference:
    """Position of a road on Earth."""

    projection: str  # PROJ string, e.g. ``+proj=utm +zone=32 ...``
    east_m: float  # of x = 0
    north_m: float  # of y = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Road(SentOnce):
    """All lanes of a map, with the rules between them.

    Attributes:
        name: stem of the map's file name.
        lanes: every usable lanelet of every kind, by id.
        origin: (latitude, longitude) of the projection.
        georeference: the projection, if it is known and the origin is a real place.
        notes: repairs and omissions with ids, one short sentence each.
        net: SUMO net of the road, used unchanged; None for maps of other formats.
        phases: the lights of ``net`` have phases of their own; those of OpenStreetMap have none.
        sumo_lanes: the lanes are SUMO's; their curves may be too tight for the limits.
        left_hand: traffic drives on the left.
        file: of the map; None if there is none.

    Example:
        >>> road = scex.read_map(scex.example_path("roundabout"))
        >>> len(road.lanes), len(road.vehicle_lanes)
        (57, 57)
    """

    name: str
    lanes: Mapping[int, Lane]
    regulations: tuple[Regulation, ...] = ()
    markings: tuple[Marking, ...] = ()
    areas: tuple[Area, ...] = ()
    origin: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    losses: tuple[MapLoss, ...] = ()
    georeference: Georeference | None = None
    net: Path | None = None
    phases: bool = True
    sumo_lanes: bool = False
    left_hand: bool = False
    file: Path | None = None

    @property
    @owner_cache
    def vehicle_lanes(self) -> dict[int, Lane]:
        """Lanes that cars may drive on, by id; nobody may change the dictionary."""
        return {i: lane for i, lane in self.lanes.items() if lane.kind == "vehicle"}
