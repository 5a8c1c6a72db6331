"""Elements of a SUMO net: lanes, edges, connections, nodes, with names and shapes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.pieces.rules import Link
from scex_sumo.converters.sumo.lanelets import LaneletPart
from scex_sumo.geometry.polylines import mean_line

DECIMALS = 3  # millimetres: what SUMO's tools expect
EXACT = 9  # decimals of lanes' shapes: drivers on a net that is read back shall plan as on its map


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
        parts: of the lanelets that its shape is made of, in driving order.
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
    """A link, its internal lane and its end points (edge names and lane indices).

    Attributes:
        link: as SUMO's right of way sees it.
        lanelets: those it runs over, from the road before to the road after, without repeats.
        enters: whether it comes from the first piece of a lane without predecessors.
        starts: (lanelet, arc length in m) of the lanelets under the internal lane, where it begins on them.
        internal: its lane within the junction.
        from_edge: name of the edge before.
        from_lane: index.
        to_edge: name of the edge after.
        to_lane: index.
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
    """A SUMO junction: incoming lanes, connections in the order of link indices, (P, 2) outline."""

    name: str
    incoming: tuple[str, ...]
    connections: tuple[Connection, ...]
    shape: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLayout:
    """A whole net, ready to be written.

    Attributes:
        edges: road edges.
        nodes: junctions.
        roads: lane of an edge, the lanelet under it and the arc length at which it begins there, m.
    """

    edges: tuple[Edge, ...]
    nodes: tuple[Node, ...]
    roads: tuple[tuple[str, int, float], ...]

    def beside(self, other: NetLayout) -> NetLayout:
        """Both nets as one; no lane of one is connected with a lane of the other."""
        return NetLayout(
            edges=self.edges + other.edges, nodes=self.nodes + other.nodes, roads=self.roads + other.roads
        )

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Connections of all junctions."""
        return tuple(c for node in self.nodes for c in node.connections)

    def places(self) -> Iterator[tuple[str, list[tuple[int, float]]]]:
        """Each SUMO lane with the lanelets under it and the arc lengths at which it begins on them, m."""
        yield from ((name, [(lanelet, start)]) for name, lanelet, start in self.roads)
        yield from ((c.internal.name, list(c.starts)) for c in self.connections)

    def ends(self) -> dict[str, tuple[str, str]]:
        """For each internal lane the edges before and after it."""
        return {c.internal.name: (c.from_edge, c.to_edge) for c in self.connections}


def shape_text(line: FloatArray, decimals: int = DECIMALS) -> str:
    """A polyline as SUMO writes it: ``x,y x,y``."""
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return " ".join(
        f"{x:.{decimals}f},{y:.{decimals}f}" for x, y in (np.round(line, decimals) + 0.0).tolist()
    )
