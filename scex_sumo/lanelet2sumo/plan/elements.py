"""Elements of a planned net: lanes, edges, junctions, connections, traffic lights, footways."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.parts import LaneletPart

if TYPE_CHECKING:
    from scex_sumo.lanelet2sumo.topology.graph import Path

WALKING_SPEED_MPS = 2.78  # SUMO's own for sidewalks


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLane:
    """Lane of an edge or of an internal edge.

    Attributes:
        length: nominal, the same for all lanes of an edge, m.
        allow: SUMO's vehicle class if only one may drive here, else empty.
        starts: lanelets under it, with the arc length in m where it begins, in driving order.
        parts: stretches of lanelets under it, in driving order.
    """

    name: str
    shape: FloatArray
    length: float
    width: float
    speed: float
    starts: tuple[tuple[int, float], ...]
    change_left: bool = False
    change_right: bool = False
    allow: str = ""
    parts: tuple[LaneletPart, ...] = ()

    @property
    def edge(self) -> str:
        """Name of its edge."""
        return self.name.rpartition("_")[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Edge:
    """A road edge: its lanes, rightmost first, and the nodes at its ends."""

    name: str
    start: str
    end: str
    lanes: tuple[NetLane, ...]


@dataclass(kw_only=True, eq=False)
class Connection:
    """A connection with its internal lane, its ends and its right of way.

    Attributes:
        entry: heading where the path enters the node, rad.
        bend: signed change of heading along the path, rad, positive to the left.
        on: lanelets whose rules apply: those of the path and of the approach.
        before: these and those before forks of the approach, whose rules apply where no other does.
        across: lanelets of the path within the node.
        on_ring: whether it comes from a lane of a roundabout.
        lanelets: from the road before to the road after, without repeats.
        enters: whether it comes from the first piece of a lane without predecessors.
        foes: indices of connections in the way of this one.
        response: indices of foes that this connection gives way to.
        state: SUMO's link state, e.g. ``M`` (priority), ``m`` (yields), ``Z`` (zipper).
    """

    path: Path
    entry: float
    bend: float
    on: frozenset[int]
    before: frozenset[int]
    across: frozenset[int]
    on_ring: bool
    lanelets: tuple[int, ...]
    enters: bool
    internal: NetLane
    from_edge: str
    from_lane: int
    to_edge: str
    to_lane: int
    foes: set[int] = field(default_factory=set)
    response: set[int] = field(default_factory=set)
    state: str = "M"


@dataclass(frozen=True, kw_only=True, eq=False)
class Node:
    """A junction: its incoming lanes, connections and outline."""

    name: str
    incoming: tuple[str, ...]
    connections: tuple[Connection, ...]
    shape: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NetLayout:
    """A whole net, ready to be written."""

    edges: tuple[Edge, ...]
    nodes: tuple[Node, ...]

    @property
    def connections(self) -> tuple[Connection, ...]:
        """Connections of all junctions."""
        return tuple(c for node in self.nodes for c in node.connections)


@dataclass(frozen=True, kw_only=True, eq=False)
class Programme:
    """A SUMO traffic light.

    Attributes:
        connections: the controlled connections; their places are the link indices.
        phases: (seconds, state), one character of state per connection.
        programme: SUMO's programID.
        crossings: edges of the controlled crossings; their link indices follow those of the connections.
    """

    name: str
    connections: tuple[Connection, ...]
    phases: tuple[tuple[float, str], ...]
    programme: str = "0"
    crossings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Crossing:
    """A crosswalk across links of one junction.

    Attributes:
        crossed: indices of the junction's links that run over it.
        edges: of these links, those nearer to it.
        areas: walking areas at its beginning and end.
        marked: whether vehicles give way there; elsewhere people do.
    """

    node: str
    crossed: tuple[int, ...]
    edges: tuple[str, ...]
    lane: NetLane
    areas: tuple[str, str]
    marked: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Sidewalk:
    """A footway of its own, with the nodes and the walking areas at its ends."""

    lane: NetLane
    nodes: tuple[str, str]
    areas: tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class Walks:
    """Pedestrian part of a net; ``areas`` and ``nodes`` hold outlines by name."""

    crossings: tuple[Crossing, ...] = ()
    areas: Mapping[str, FloatArray] = field(default_factory=dict)
    sidewalks: tuple[Sidewalk, ...] = ()
    nodes: Mapping[str, FloatArray] = field(default_factory=dict)

    def at(self, node: str) -> list[Crossing]:
        """Crossings of a junction."""
        return [c for c in self.crossings if c.node == node]

    def incoming(self, node: str) -> list[str]:
        """Return lanes for people that lead into a junction."""
        ending = [s.lane.name for s in self.sidewalks if s.nodes[1] == node]
        return [*ending, *dict.fromkeys(f"{c.areas[0]}_0" for c in self.at(node))]
