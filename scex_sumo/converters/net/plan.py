"""Planning of the SUMO net: the names and shapes of edges, connections and nodes for cut rows of lanes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.elements import Connection, Edge, NetLane, NetLayout, Node
from scex_sumo.converters.net.outlines import border, lane_area, union_outline
from scex_sumo.converters.net.pieces.borders import ENTRY
from scex_sumo.converters.net.pieces.rings import ring_lanes
from scex_sumo.converters.net.pieces.rows import Piece
from scex_sumo.converters.net.pieces.rules import (
    Link,
    approach,
    clashing_pieces,
    links_by_node,
    set_foes,
    set_right_of_way,
)
from scex_sumo.converters.net.pieces.topology import Cut, Path, Topology
from scex_sumo.converters.sumo.lanelets import BEYOND, JOINT_M, LaneletPart
from scex_sumo.geometry.polylines import bend, cut, heading, join, length_of, width_along
from scex_sumo.road import Regulation
from scex_sumo.roads.conflicts import Conflict


def plan_net(topology: Topology, rules: Sequence[Regulation], found: Sequence[Conflict]) -> NetLayout:
    """Names and shapes for a topology, and who gives way to whom.

    Args:
        topology: the cut rows of lanes.
        rules: of the map.
        found: conflicts of the lanes.
    """
    plan = _Plan(topology)
    edges = tuple(plan.edges())
    incoming: dict[str, list[str]] = {}
    for edge in edges:
        incoming.setdefault(edge.start, [])
        incoming.setdefault(edge.end, []).extend(lane.name for lane in edge.lanes)
    connections = plan.connections(incoming, rules, found)
    at_node: dict[str, list[Edge]] = {}
    for edge in edges:
        for name in dict.fromkeys((edge.start, edge.end)):
            at_node.setdefault(name, []).append(edge)
    nodes = tuple(
        Node(
            name=name,
            incoming=tuple(lanes),
            connections=connections.get(name, ()),
            shape=plan.outline(name, connections.get(name, ()), at_node[name]),
        )
        for name, lanes in incoming.items()
    )
    return NetLayout(edges=edges, nodes=nodes, roads=tuple(plan.roads()))


class _Plan:
    """Names and shapes of the pieces of a topology."""

    def __init__(self, topology: Topology) -> None:
        self._topology = topology
        self._lanes = topology.lanes
        self._ring = ring_lanes(topology.lanes)
        self._widths: dict[Piece, float] = {}
        self._shapes: dict[Piece, FloatArray] = {}

    def edges(self) -> Iterator[Edge]:
        """Edges of all road pieces, row by row."""
        for r, row in enumerate(self._topology.rows):
            for k in self._roads(r):
                name = self._edge_name(r, k)
                start, end = (self._node_name(self._topology.node(r, c)) for c in (k, k + 1))
                shapes = [self._road_shape((r, k, at)) for at in range(len(row.lanes))]
                nominal = float(np.mean([length_of(shape) for shape in shapes]))
                lanes = tuple(
                    self._road_lane(f"{name}_{at}", (r, k, at), shape, nominal)
                    for at, shape in enumerate(shapes)
                )
                yield Edge(name=name, start=start, end=end, lanes=lanes)

    def roads(self) -> Iterator[tuple[str, int, float]]:
        """Lanes of edges, the lanelet under each, and where it begins there, m."""
        for r, row in enumerate(self._topology.rows):
            for k in self._roads(r):
                for at, lanelet in enumerate(row.lanes):
                    yield self._lane_name((r, k, at)), lanelet, row.span(k, at)[0]

    def connections(
        self, incoming: Mapping[str, Sequence[str]], rules: Sequence[Regulation], found: Sequence[Conflict]
    ) -> dict[str, tuple[Connection, ...]]:
        """Connections of each node, in the order of its incoming lanes."""
        clashes = clashing_pieces(self._topology, found)
        named = {rule.element_id: {*rule.lanes, *rule.yielding, *rule.priority} for rule in rules}
        result = {}
        for cut_, paths in links_by_node(self._topology).items():
            node = self._node_name(cut_)
            order = {name: k for k, name in enumerate(incoming[node])}
            shapes = {path: self._inner_shape(path) for path in paths}
            paths = sorted(paths, key=lambda p: (order[self._lane_name(p.start)], self._lane_name(p.end)))
            links = [self._link(path, shapes[path]) for path in paths]
            merging = set_foes(links, clashes)
            on = {i for link in links for i in link.on}
            set_right_of_way(links, merging, [rule for rule in rules if named[rule.element_id] & on])
            result[node] = tuple(
                self._connection(node, k, link, shapes[link.path]) for k, link in enumerate(links)
            )
        return result

    def outline(self, node: str, connections: Sequence[Connection], edges: Sequence[Edge]) -> FloatArray:
        """Union of the lanelets within a node; where there are none, the border between its edges."""
        inside = {piece for c in connections for piece in c.link.path.inside}
        areas = []
        for piece in sorted(inside):
            row = self._topology.rows[piece[0]]
            areas.append(lane_area(self._lanes[row.lanes[piece[2]]], row.span(piece[1], piece[2])))
        union = union_outline(areas)
        return union if len(union) else border(node, edges)

    def _node_name(self, node: Cut) -> str:
        row, k = node
        return f"j{min(self._topology.rows[row].lanes)}" + (f"#{k}" if k else "")

    def _roads(self, row: int) -> list[int]:
        """Pieces of a row that are road."""
        return [k for k, inside in enumerate(self._topology.rows[row].inside) if not inside]

    def _edge_name(self, row: int, piece: int) -> str:
        roads = self._roads(row)
        number = f"#{roads.index(piece)}" if len(roads) > 1 else ""
        return f"l{self._topology.rows[row].lanes[0]}{number}"

    def _lane_name(self, piece: Piece) -> str:
        return f"{self._edge_name(*piece[:2])}_{piece[2]}"

    def _road_lane(self, name: str, piece: Piece, shape: FloatArray, nominal: float) -> NetLane:
        row = self._topology.rows[piece[0]]
        lane = self._lanes[row.lanes[piece[2]]]
        left = row.lanes[piece[2] + 1] if piece[2] + 1 < len(row.lanes) else None
        right = row.lanes[piece[2] - 1] if piece[2] else None
        return NetLane(
            name=name,
            shape=shape,
            length=nominal,
            width=self._width([piece]),
            speed=lane.speed_limit_mps,
            lanelets=(lane.lane_id,),
            change_left=left is not None and lane.left == left,
            change_right=right is not None and lane.right == right,
            allow="" if lane.kind == "vehicle" else lane.kind,
            parts=tuple(self._lanelet_parts([(piece, *self._trims(piece))])),
        )

    def _trims(self, piece: Piece) -> tuple[float, float]:
        """Arc lengths between which a road piece is an edge; connections take the rest."""
        row, lane = self._topology.rows[piece[0]], self._lanes[self._topology.lane_id(piece)]
        start, end = row.span(piece[1], piece[2])
        joint = min(JOINT_M, (end - start) / 4)
        known = self._topology.where
        first = not row.inside[piece[1] - 1] if piece[1] else any(i in known for i in lane.predecessors)
        if piece[1] + 1 < row.pieces:
            last = not row.inside[piece[1] + 1]
        else:
            last = any(i in known for i in lane.successors)
        return start + joint * first, end - joint * last

    def _road_shape(self, piece: Piece) -> FloatArray:
        if piece not in self._shapes:
            line = self._lanes[self._topology.lane_id(piece)].centreline
            self._shapes[piece] = cut(line, *self._trims(piece))
        return self._shapes[piece]

    def _inner_parts(self, path: Path) -> Iterator[tuple[Piece, float, float]]:
        """The end of the road before, the junction pieces, the beginning of the road after: arc lengths."""
        last = len(path.pieces) - 1
        for k, piece in enumerate(path.pieces):
            start, end = self._topology.rows[piece[0]].span(piece[1], piece[2])
            if k == 0:
                start = self._trims(piece)[1]
            if k == last:
                end = self._trims(piece)[0]
            if end - start > 1e-9:
                yield piece, start, end

    def _inner_shape(self, path: Path) -> FloatArray:
        known = self._topology
        return join(
            [
                cut(self._lanes[known.lane_id(piece)].centreline, start, end)
                for piece, start, end in self._inner_parts(path)
            ]
        )

    def _lanelet_parts(self, parts: Iterable[tuple[Piece, float, float]]) -> Iterator[LaneletPart]:
        """Parts of lanes, with what a reader of the net cannot see: the width and limit of the whole lane."""
        for piece, start, end in parts:
            lane = self._lanes[self._topology.lane_id(piece)]
            lanelet = BEYOND if lane.subtype == ENTRY else lane.lane_id
            yield LaneletPart(lanelet, start, end, lane.width_m, lane.speed_limit_mps)

    def _width(self, pieces: Sequence[Piece]) -> float:
        """Mean distance of the bounds along pieces, weighted by length, m."""
        widths = [self._piece_width(piece) for piece in pieces]
        spans = [self._topology.rows[row].span(k, at) for row, k, at in pieces]
        sizes = [max(end - start, 1e-3) for start, end in spans]
        return max(float(np.average(widths, weights=sizes)), 0.5)

    def _piece_width(self, piece: Piece) -> float:
        """Mean distance of the bounds along a piece, m; many ways through a junction share one."""
        if piece not in self._widths:
            row = self._topology.rows[piece[0]]
            lane = self._lanes[row.lanes[piece[2]]]
            line = cut(lane.centreline, *row.span(piece[1], piece[2]))
            self._widths[piece] = width_along(lane.left_bound, lane.right_bound, line)
        return self._widths[piece]

    def _link(self, path: Path, shape: FloatArray) -> Link:
        start = self._road_shape(path.start)
        turned = bend(shape)
        return Link(
            path=path,
            entry=heading(start, end=True),
            bend=turned,
            on=approach(self._topology, path),
            on_ring=self._topology.lane_id(path.start) in self._ring,
        )

    def _connection(self, node: str, index: int, link: Link, shape: FloatArray) -> Connection:
        path = link.path
        over = path.inside or (path.start, path.end)
        ids = [self._topology.lane_id(piece) for piece in over]
        first = self._lanes[self._topology.lane_id(path.start)]
        internal = NetLane(
            name=f":{node}_{index}_0",
            shape=shape,
            length=length_of(shape),
            width=self._width(over),
            speed=min(self._lanes[i].speed_limit_mps for i in (ids if path.inside else ids[1:])),
            lanelets=tuple(dict.fromkeys(ids)),
            allow="" if self._lanes[ids[0]].kind == "vehicle" else self._lanes[ids[0]].kind,
            parts=tuple(self._lanelet_parts(self._inner_parts(path))),
        )
        driven = [self._topology.lane_id(piece) for piece in path.pieces]
        return Connection(
            link=link,
            internal=internal,
            lanelets=tuple(i for k, i in enumerate(driven) if k == 0 or driven[k - 1] != i),
            enters=path.start[1] == 0
            and self._topology.rows[path.start[0]].pieces > 1
            and not first.predecessors,
            starts=self._starts(path, over),
            from_edge=self._edge_name(*path.start[:2]),
            from_lane=path.start[2],
            to_edge=self._edge_name(*path.end[:2]),
            to_lane=path.end[2],
        )

    def _starts(self, path: Path, over: Sequence[Piece]) -> tuple[tuple[int, float], ...]:
        """Lanelets under a connection, and the arc lengths at which it begins on them, m."""
        starts = {}
        for piece in over:
            start, end = self._topology.rows[piece[0]].span(piece[1], piece[2])
            joint = not path.inside and piece == path.start
            # A joint covers the very end of the lanelet before and the very start of the one after.
            starts[self._topology.lane_id(piece)] = end if joint else start - 1e-6
        return tuple(starts.items())
