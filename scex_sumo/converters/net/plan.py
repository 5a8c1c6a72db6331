"""The SUMO net as plain data: edges, nodes and connections with names and shapes, ready to be written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.elements import Connection, Edge, NetLane, Node
from scex_sumo.converters.net.outlines import border, lane_area, union_outline
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
from scex_sumo.geometry.polylines import bend, cut, heading, join, length_of, width_along
from scex_sumo.road import Road
from scex_sumo.roads.conflicts import Conflict

JOINT_M = 0.05  # where road follows road, the connection takes this much of both: SUMO wants lengths > 0


class NetLayout:
    """Names and shapes for a topology.

    Attributes:
        edges: road edges.
        nodes: junctions by name.
    """

    def __init__(self, road: Road, topology: Topology, found: Sequence[Conflict]) -> None:
        self._road = road
        self._topology = topology
        self._lanes = topology.lanes
        self._ring = ring_lanes(topology.lanes)
        self.nodes: dict[str, Node] = {}
        self.edges = tuple(self._edges())
        self._parts = [self]
        self._own_nodes = list(self.nodes.values())
        self._by_name = {edge.name: edge for edge in self.edges}
        self._leaving: dict[tuple[str, int], list[Connection]] = {}
        self._connect(found)
        for name in self._cuts_by_node().values():
            self.nodes[name].shape = self._outline(self.nodes[name])

    def ends(self) -> dict[str, tuple[str, str]]:
        """For each internal lane the edges before and after it."""
        links = [c for node in self.nodes.values() for c in node.connections]
        return {c.internal.name: (c.from_edge, c.to_edge) for c in links}

    def places(self) -> Iterator[tuple[str, list[tuple[int, float]]]]:
        """Each SUMO lane with the lanelets under it and the arc lengths at which it begins on them, m."""
        for part in self._parts:
            yield from part._own_places()

    def _own_places(self) -> Iterator[tuple[str, list[tuple[int, float]]]]:
        topology = self._topology
        for r, row in enumerate(topology.rows):
            for k, inside in enumerate(row.inside):
                if not inside:
                    for at_, lanelet in enumerate(row.lanes):
                        yield self._lane_name((r, k, at_)), [(lanelet, row.span(k, at_)[0])]
        for node in self._own_nodes:
            for c in node.connections:
                path, starts = c.link.path, []
                for piece in path.inside or (path.start, path.end):
                    start, end = topology.rows[piece[0]].span(piece[1], piece[2])
                    joint = not path.inside and piece == path.start
                    # A joint covers the very end of the lanelet before and the very start of the one after.
                    starts.append((topology.lane_id(piece), end if joint else start - 1e-6))
                yield c.internal.name, list(dict(starts).items())

    def add(self, other: NetLayout) -> None:
        """Take in another part of the net, of other lanes, connected with nothing here."""
        self._parts.append(other)
        self.edges += other.edges
        self.nodes.update(other.nodes)

    @property
    def lane_lengths(self) -> dict[int, float]:
        """Length of every vehicle lane by id, m."""
        return {i: self._topology.rows[r].lengths[k] for i, (r, k) in self._topology.where.items()}

    def successors(self, lane_id: int) -> tuple[int, ...]:
        """Lanes that follow a lane."""
        return self._lanes[lane_id].successors

    def begins(self, connection: Connection) -> bool:
        """Whether a connection comes from the first piece of a lane without predecessors."""
        row, piece, _ = connection.link.path.start
        lane = self._lanes[self._topology.lane_id(connection.link.path.start)]
        return piece == 0 and self._topology.rows[row].pieces > 1 and not lane.predecessors

    def lanelets(self, connection: Connection) -> list[int]:
        """Lanelets that a connection runs over, from the road before to the road after, without repeats."""
        ids = [self._topology.lane_id(piece) for piece in connection.link.path.pieces]
        return [i for k, i in enumerate(ids) if k == 0 or ids[k - 1] != i]

    def lane_shape(self, edge: str, index: int) -> FloatArray:
        """Shape of a lane of an edge."""
        return self._by_name[edge].lanes[index].shape

    def ahead(self, connection: Connection, reach: float) -> list[FloatArray]:
        """Shapes of the lanes of edges that lie behind a connection, up to a distance, m."""
        shapes, stack, seen = [], [(connection, reach)], {connection.internal.name}
        while stack:
            c, left = stack.pop()
            shape = self.lane_shape(c.to_edge, c.to_lane)
            shapes.append(shape)
            left -= c.internal.length + length_of(shape)
            for following in self._leaving.get((c.to_edge, c.to_lane), ()):
                if left > 0 and following.internal.name not in seen:
                    seen.add(following.internal.name)
                    stack.append((following, left))
        return shapes

    def _node_name(self, node: Cut) -> str:
        row, k = node
        ring = self._topology.rows[row]
        return f"j{min(ring.lanes)}" + (f"#{k}" if k else "")

    def _cuts_by_node(self) -> dict[Cut, str]:
        topology = self._topology
        cuts = {topology.node(r, k) for r, row in enumerate(topology.rows) for k in range(row.pieces + 1)}
        return {cut_: self._node_name(cut_) for cut_ in sorted(cuts) if self._node_name(cut_) in self.nodes}

    def _edge_name(self, row: int, piece: int) -> str:
        ring = self._topology.rows[row]
        roads = [k for k, inside in enumerate(ring.inside) if not inside]
        return f"l{ring.lanes[0]}" + (f"#{roads.index(piece)}" if len(roads) > 1 else "")

    def _edges(self) -> Iterator[Edge]:
        for r, row in enumerate(self._topology.rows):
            for k, inside in enumerate(row.inside):
                if inside:
                    continue
                name = self._edge_name(r, k)
                start, end = (self._node_name(self._topology.node(r, c)) for c in (k, k + 1))
                shapes = [self._road_shape((r, k, at_)) for at_ in range(len(row.lanes))]
                nominal = float(np.mean([length_of(shape) for shape in shapes]))
                lanes = tuple(
                    self._road_lane(f"{name}_{at_}", (r, k, at_), shape, nominal)
                    for at_, shape in enumerate(shapes)
                )
                yield Edge(name=name, start=start, end=end, lanes=lanes)
                self.nodes.setdefault(start, Node(name=start))
                self.nodes.setdefault(end, Node(name=end)).incoming += [lane.name for lane in lanes]

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
        return cut(self._lanes[self._topology.lane_id(piece)].centreline, *self._trims(piece))

    def _inner_shape(self, path: Path) -> FloatArray:
        """The end of the road before, the junction pieces, the beginning of the road after."""
        topology, parts = self._topology, []
        last = len(path.pieces) - 1
        for k, piece in enumerate(path.pieces):
            start, end = topology.rows[piece[0]].span(piece[1], piece[2])
            if k == 0:
                start = self._trims(piece)[1]
            if k == last:
                end = self._trims(piece)[0]
            if end - start > 1e-9:
                parts.append(cut(self._lanes[topology.lane_id(piece)].centreline, start, end))
        return join(parts)

    def _width(self, pieces: Sequence[Piece]) -> float:
        """Mean distance of the bounds along pieces, weighted by length, m."""
        widths, sizes = [], []
        for piece in pieces:
            row = self._topology.rows[piece[0]]
            lane = self._lanes[row.lanes[piece[2]]]
            start, end = row.span(piece[1], piece[2])
            line = cut(lane.centreline, start, end)
            widths.append(width_along(lane.left_bound, lane.right_bound, line))
            sizes.append(max(end - start, 1e-3))
        return max(float(np.average(widths, weights=sizes)), 0.5)

    def _connect(self, found: Sequence[Conflict]) -> None:
        clashes = clashing_pieces(self._topology, found)
        for cut_, paths in links_by_node(self._topology).items():
            node = self.nodes[self._node_name(cut_)]
            order = {name: k for k, name in enumerate(node.incoming)}
            shapes = {path: self._inner_shape(path) for path in paths}
            paths = sorted(paths, key=lambda p: (order[self._lane_name(p.start)], self._lane_name(p.end)))
            links = [self._link(path, shapes[path]) for path in paths]
            merging = set_foes(links, clashes)
            set_right_of_way(links, merging, self._road.regulations)
            for k, link in enumerate(links):
                connection = self._connection(node.name, k, link, shapes[link.path])
                node.connections.append(connection)
                self._leaving.setdefault((connection.from_edge, connection.from_lane), []).append(connection)

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

    def _lane_name(self, piece: Piece) -> str:
        return f"{self._edge_name(*piece[:2])}_{piece[2]}"

    def _connection(self, node: str, index: int, link: Link, shape: FloatArray) -> Connection:
        path = link.path
        over = path.inside or (path.start, path.end)
        ids = [self._topology.lane_id(piece) for piece in over]
        internal = NetLane(
            name=f":{node}_{index}_0",
            shape=shape,
            length=length_of(shape),
            width=self._width(over),
            speed=min(self._lanes[i].speed_limit_mps for i in (ids if path.inside else ids[1:])),
            lanelets=tuple(dict.fromkeys(ids)),
            allow="" if self._lanes[ids[0]].kind == "vehicle" else self._lanes[ids[0]].kind,
        )
        return Connection(
            link=link,
            internal=internal,
            from_edge=self._edge_name(*path.start[:2]),
            from_lane=path.start[2],
            to_edge=self._edge_name(*path.end[:2]),
            to_lane=path.end[2],
        )

    def _outline(self, plan: Node) -> FloatArray:
        """Union of the lanelets within a node; where there are none, the border between its edges."""
        inside = {piece for c in plan.connections for piece in c.link.path.inside}
        areas = []
        for piece in sorted(inside):
            row = self._topology.rows[piece[0]]
            areas.append(lane_area(self._lanes[row.lanes[piece[2]]], row.span(piece[1], piece[2])))
        return union_outline(areas) if areas else border(plan.name, self.edges)
