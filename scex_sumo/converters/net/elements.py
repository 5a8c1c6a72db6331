"""What a SUMO net is made of: lanes, edges, connections, nodes, with names and shapes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.pieces.rules import Link
from scex_sumo.geometry.polylines import mean_line

DECIMALS = 3  # millimetres: a tenth of what the 0.01 m target needs, and what SUMO's tools expect


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLane:
    """One lane of an edge or of an internal edge.

    Attributes:
        name: SUMO's lane id.
        shape: (P, 2) m.
        length: nominal length, the same for all lanes of an edge, m.
        width: m.
        speed: m/s.
        lanelets: the lanelets it runs over, in driving order.
        change_left: whether a vehicle may change to the left.
        change_right: whether a vehicle may change to the right.
        allow: SUMO's vehicle class where only one may drive here, or an empty string.
    """

    name: str
    shape: FloatArray
    length: float
    width: float
    speed: float
    lanelets: tuple[int, ...]
    change_left: bool = False
    change_right: bool = False
    allow: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Edge:
    """A road edge with its lanes, rightmost first, and the nodes at its ends."""

    name: str
    start: str
    end: str
    lanes: tuple[NetLane, ...]

    @property
    def shape(self) -> FloatArray:
        """(P, 2) mean line of the lanes; SUMO itself goes by the lanes, exports by this."""
        return mean_line([lane.shape for lane in self.lanes])


@dataclass(frozen=True, kw_only=True, eq=False)
class Connection:
    """A link, its internal lane and its end points (edge names and lane indices)."""

    link: Link
    internal: NetLane
    from_edge: str
    from_lane: int
    to_edge: str
    to_lane: int


@dataclass(kw_only=True, eq=False)
class Node:
    """A SUMO junction: its incoming lanes and its connections, in the order of link indices."""

    name: str
    incoming: list[str] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    shape: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))


def shape_text(line: FloatArray) -> str:
    """A polyline as SUMO writes it: ``x,y x,y``."""
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return " ".join(f"{x:.{DECIMALS}f},{y:.{DECIMALS}f}" for x, y in np.round(line, DECIMALS) + 0.0)
