"""Elements of a SUMO net: lanes, edges, connections and nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.lanelets import LaneletPart
from scex_sumo.converters.net.right_of_way import Link
from scex_sumo.geometry.polylines import mean_line

DECIMALS = 3  # millimetres: what SUMO's tools expect
EXACT = 9  # decimals of lanes' shapes: drivers on a net that is read back shall plan as on its map


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLane:
    """Lane of an edge or of an internal edge.

    Attributes:
        length: nominal, the same for all lanes of an edge, m.
        allow: SUMO's vehicle class if only one may drive here, else empty.
        parts: stretches of lanelets under it, in driving order.
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
    parts: tuple[LaneletPart, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Edge:
    """A road edge: its lanes, rightmost first, and the nodes at its ends."""

    name: str
    start: str
    end: str
    lanes: tuple[NetLane, ...]

    @property
    def shape(self) -> FloatArray:
        """(P, 2) mean line of the lanes. SUMO itself uses the lanes; exports use this line."""
        return mean_line([lane.shape for lane in self.lanes])


@dataclass(frozen=True, kw_only=True, eq=False)
class Connection:
    """Link with its internal lane and its ends.

    Attributes:
        lanelets: from the road before to the road after, without repeats.
        enters: whether it comes from the first piece of a lane without predecessors.
        starts: lanelets under the internal lane, with the arc length in m where it begins.
    """

    link: Link
    lanelets: tuple[int, ...]
    enters: bool
    starts: tuple[tuple[int, float], ...]
    internal: NetLane
    from_edge: str
    from_lane: int
    to_edge: str
    to_lane: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Node:
    """A junction: its incoming lanes, connections and outline."""

    name: str
    incoming: tuple[str, ...]
    connections: tuple[Connection, ...]
    shape: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLayout:
    """A whole net, ready to be written; ``roads`` as `_Plan.roads`."""

    edges: tuple[Edge, ...]
    nodes: tuple[Node, ...]
    roads: tuple[tuple[str, int, float], ...]

    def beside(self, other: NetLayout) -> NetLayout:
        """Return both nets as one."""
        return NetLayout(
            edges=self.edges + other.edges, nodes=self.nodes + other.nodes, roads=self.roads + other.roads
        )

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Connections of all junctions."""
        return tuple(c for node in self.nodes for c in node.connections)

    def places(self) -> Iterator[tuple[str, list[tuple[int, float]]]]:
        """Each SUMO lane, with (lanelet under it, arc length in m where the lane begins)."""
        yield from ((name, [(lanelet, start)]) for name, lanelet, start in self.roads)
        yield from ((c.internal.name, list(c.starts)) for c in self.connections)

    def ends(self) -> dict[str, tuple[str, str]]:
        """Return the edges before and after each internal lane."""
        return {c.internal.name: (c.from_edge, c.to_edge) for c in self.connections}


def shape_text(line: FloatArray, decimals: int = DECIMALS) -> str:
    """Format a polyline as SUMO does: ``x,y x,y``."""
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return " ".join(
        f"{x:.{decimals}f},{y:.{decimals}f}" for x, y in (np.round(line, decimals) + 0.0).tolist()
    )
