"""Plan of the SUMO net: names, shapes and outlines of its elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
import shapely
from shapely import MultiPoint, Polygon, unary_union

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.parts import BEYOND, CHANGED_M, JOINT_M, LaneletPart
from scex_sumo.geometry.bounds import bend
from scex_sumo.geometry.polylines import along, cut, heading, length_of, project, samples
from scex_sumo.lanelet2sumo.plan.elements import Connection, Edge, NetLane, NetLayout, Node
from scex_sumo.lanelet2sumo.plan.right_of_way import (
    approach,
    clashing_pieces,
    ring_lanes,
    set_foes,
    set_right_of_way,
)
from scex_sumo.lanelet2sumo.topology.borders import ENTRY
from scex_sumo.lanelet2sumo.topology.graph import Cut, Path, Piece, Topology
from scex_sumo.road import Lane, Regulation
from scex_sumo.roads.conflicts import Conflict


def plan_net(topology: Topology, rules: Sequence[Regulation], conflicts: Sequence[Conflict]) -> NetLayout:
    """Name and shape everything of a topology, and decide the right of way."""
    plan = _Plan(topology)
    edges = tuple(plan.edges())
    incoming: dict[str, list[str]] = {}
    at_node: dict[str, list[Edge]] = {}
    for edge in edges:
        incoming.setdefault(edge.start, [])
        incoming.setdefault(edge.end, []).extend(lane.name for lane in edge.lanes)
        for name in dict.fromkeys((edge.start, edge.end)):
            at_node.setdefault(name, []).append(edge)
    connections = plan.connections(incoming, rules, conflicts)
    nodes = []
    for name, lanes in incoming.items():
        links = connections.get(name, ())
        shape = plan.outline(name, links, at_node[name])
        nodes.append(Node(name=name, incoming=tuple(lanes), connections=links, shape=shape))
    return NetLayout(edges=edges, nodes=tuple(nodes))


class _Plan:
    def __init__(self, topology: Topology) -> None:
        self._topology = topology
        self._ring = ring_lanes(topology.lanes)
        self._widths: dict[Piece, float] = {}
        self._shapes: dict[Piece, FloatArray] = {}

    def edges(self) -> Iterator[Edge]:
        for r, row in enumerate(self._topology.rows):
            for k in self._roads(r):
                name = self._edge_name(r, k)
                start, end = (self._node_name(self._topology.node(r, c)) for c in (k, k + 1))
                shapes = [self._road_shape((r, k, index)) for index in range(len(row.lanes))]
                nominal = float(np.mean([length_of(shape) for shape in shapes]))
                lanes = tuple(
                    self._road_lane(f"{name}_{index}", (r, k, index), shape, nominal)
                    for index, shape in enumerate(shapes)
                )
                yield Edge(name=name, start=start, end=end, lanes=lanes)

    def connections(
        self,
        incoming: Mapping[str, Sequence[str]],
        rules: Sequence[Regulation],
        conflicts: Sequence[Conflict],
    ) -> dict[str, tuple[Connection, ...]]:
        clashes = clashing_pieces(self._topology, conflicts)
        named = {rule.element_id: {*rule.lanes, *rule.yielding, *rule.priority} for rule in rules}
        result = {}
        for cut_, paths in self._topology.paths_by_node().items():
            node = self._node_name(cut_)
            order = {name: k for k, name in enumerate(incoming[node])}
            shapes = {path: self._inner_shape(path) for path in paths}
            paths = sorted(paths, key=lambda p: (order[self._lane_name(p.start)], self._lane_name(p.end)))
            links = [self._connection(node, k, path, shapes[path]) for k, path in enumerate(paths)]
            merging = set_foes(links, clashes)
            on = {i for link in links for i in link.before}
            set_right_of_way(links, merging, [rule for rule in rules if named[rule.element_id] & on])
            result[node] = tuple(links)
        return result

    def outline(self, node: str, connections: Sequence[Connection], edges: Sequence[Edge]) -> FloatArray:
        inside = {piece for c in connections for piece in c.path.inside}
        areas = [_lane_area(self._topology.lane(p), self._topology.span(p)) for p in sorted(inside)]
        union = unary_union(shapely.buffer(areas, 0.01, quad_segs=16))
        area = union if union.geom_type == "Polygon" else union.convex_hull
        if area.geom_type == "Polygon" and not area.is_empty:
            return np.asarray(area.simplify(0.05).exterior.coords)[:-1]
        ends = [(e, end) for e in edges for end in (False, True) if node == (e.end if end else e.start)]
        return hull([corners(lane.shape, lane.width, end=end) for e, end in ends for lane in e.lanes])

    def _node_name(self, node: Cut) -> str:
        row, k = node
        return f"j{min(self._topology.rows[row].lanes)}" + (f"#{k}" if k else "")

    def _roads(self, row: int) -> list[int]:
        return [k for k, inside in enumerate(self._topology.rows[row].inside) if not inside]

    def _edge_name(self, row: int, piece: int) -> str:
        roads = self._roads(row)
        number = f"#{roads.index(piece)}" if len(roads) > 1 else ""
        return f"l{self._topology.rows[row].lanes[0]}{number}"

    def _lane_name(self, piece: Piece) -> str:
        return f"{self._edge_name(*piece[:2])}_{piece[2]}"

    def _road_lane(self, name: str, piece: Piece, shape: FloatArray, nominal: float) -> NetLane:
        row, lane = self._topology.rows[piece[0]], self._topology.lane(piece)
        left = row.lanes[piece[2] + 1] if piece[2] + 1 < len(row.lanes) else None
        right = row.lanes[piece[2] - 1] if piece[2] else None
        return NetLane(
            name=name,
            shape=shape,
            length=nominal,
            width=self._width([piece]),
            speed=lane.speed_limit_mps,
            starts=((lane.lane_id, self._topology.span(piece)[0]),),
            change_left=left is not None and lane.left == left,
            change_right=right is not None and lane.right == right,
            allow="" if lane.kind == "vehicle" else lane.kind,
            parts=(self._lanelet_part(piece, *self._trims(piece)),),
        )

    def _trims(self, piece: Piece) -> tuple[float, float]:
        row, lane, k = self._topology.rows[piece[0]], self._topology.lane(piece), piece[1]
        start, end = self._topology.span(piece)
        joint, known = min(JOINT_M, (end - start) / 4), self._topology.where
        first = not row.inside[k - 1] if k else any(i in known for i in lane.predecessors)
        more = k + 1 < row.pieces
        last = not row.inside[k + 1] if more else any(i in known for i in lane.successors)
        return start + joint * first, end - joint * last

    def _road_shape(self, piece: Piece) -> FloatArray:
        if piece not in self._shapes:
            self._shapes[piece] = cut(self._topology.lane(piece).centreline, *self._trims(piece))
        return self._shapes[piece]

    def _inner_parts(self, path: Path) -> Iterator[tuple[Piece, float, float]]:
        for piece in path.pieces:
            start, end = self._topology.span(piece)
            start = self._trims(piece)[1] if piece == path.start else start
            end = self._trims(piece)[0] if piece == path.end else end
            if end - start > 1e-9:
                yield piece, start, end

    def _inner_shape(self, path: Path) -> FloatArray:
        parts = self._inner_parts(path)
        line = np.vstack([cut(self._topology.lane(piece).centreline, *span) for piece, *span in parts])
        keep = np.concatenate([[True], np.hypot(*np.diff(line, axis=0).T) > 1e-4])
        return line[keep] if keep.sum() > 1 else line[[0, -1]]

    def _lanelet_part(self, piece: Piece, start: float, end: float) -> LaneletPart:
        lane = self._topology.lane(piece)
        lanelet = BEYOND if lane.subtype == ENTRY else lane.lane_id
        return LaneletPart(lanelet, start, end, lane.width_m, lane.speed_limit_mps)

    def _joined_parts(self, path: Path) -> Iterator[LaneletPart]:
        """Yield the stretches of an internal lane, with those between lanelets that do not meet."""
        reached = None
        for piece, start, end in self._inner_parts(path):
            stretch = self._lanelet_part(piece, start, end)
            line = cut(self._topology.lane(piece).centreline, start, end)
            gap = 0.0 if reached is None else math.dist(reached, line[0])
            if gap > CHANGED_M:
                yield replace(stretch, lanelet=BEYOND, start=0.0, end=gap)
            yield stretch
            reached = line[-1]

    def _width(self, pieces: Sequence[Piece]) -> float:
        widths = [self._piece_width(piece) for piece in pieces]
        sizes = [max(end - start, 1e-3) for start, end in map(self._topology.span, pieces)]
        return max(float(np.average(widths, weights=sizes)), 0.5)

    def _piece_width(self, piece: Piece) -> float:
        if piece not in self._widths:
            lane = self._topology.lane(piece)
            line = cut(lane.centreline, *self._topology.span(piece))
            points = samples(line, 1.0)[1]
            sides = [project(points, bound)[1] for bound in (lane.left_bound, lane.right_bound)]
            self._widths[piece] = float(np.mean(sides[0] + sides[1]))
        return self._widths[piece]

    def _connection(self, node: str, index: int, path: Path, shape: FloatArray) -> Connection:
        over = path.inside or (path.start, path.end)
        lanes = [self._topology.lane(piece) for piece in over]
        first = self._topology.lane(path.start)
        internal = NetLane(
            name=f":{node}_{index}_0",
            shape=shape,
            length=length_of(shape),
            width=self._width(over),
            speed=min(lane.speed_limit_mps for lane in (lanes if path.inside else lanes[1:])),
            starts=self._starts(path, over),
            allow="" if lanes[0].kind == "vehicle" else lanes[0].kind,
            parts=tuple(self._joined_parts(path)),
        )
        driven = [self._topology.lane(piece).lane_id for piece in path.pieces]
        pieces = self._topology.rows[path.start[0]].pieces
        return Connection(
            path=path,
            entry=heading(self._road_shape(path.start), end=True),
            bend=bend(shape),
            on=approach(self._topology, path),
            before=approach(self._topology, path, forks=True),
            across=frozenset(self._topology.lane(piece).lane_id for piece in path.inside),
            on_ring=first.lane_id in self._ring,
            internal=internal,
            lanelets=tuple(i for i, _ in groupby(driven)),
            enters=path.start[1] == 0 and pieces > 1 and not first.predecessors,
            from_edge=self._edge_name(*path.start[:2]),
            from_lane=path.start[2],
            to_edge=self._edge_name(*path.end[:2]),
            to_lane=path.end[2],
        )

    def _starts(self, path: Path, over: Sequence[Piece]) -> tuple[tuple[int, float], ...]:
        starts = {}
        for piece in over:
            start, end = self._topology.span(piece)
            joint = not path.inside and piece == path.start
            # A joint covers the very end of the lanelet before and the very start of the one after.
            starts[self._topology.lane(piece).lane_id] = end if joint else start - 1e-6
        return tuple(starts.items())


def _lane_area(lane: Lane, span: tuple[float, float]) -> Polygon:
    ends = along(lane.centreline, np.array(span))
    sides = [_between(bound, ends) for bound in (lane.left_bound, lane.right_bound)]
    return Polygon(np.vstack([sides[0], sides[1][::-1]])).buffer(0)


def corners(shape: FloatArray, width: float, *, end: bool, reach: float = 2.0) -> FloatArray:
    """(2, 2) left and right corner of a lane's end, m; its heading is that of the last ``reach`` metres."""
    angle, tip = heading(shape, end=end, reach=reach), shape[-1 if end else 0]
    across = np.array([-np.sin(angle), np.cos(angle)]) * width / 2
    return np.array([tip + across, tip - across])


def hull(points: Sequence[FloatArray]) -> FloatArray:
    """Return the (P, 2) convex hull of points, in order."""
    shape = MultiPoint(np.vstack(points)).convex_hull
    return np.asarray(shape.exterior.coords[:-1] if shape.geom_type == "Polygon" else shape.coords)


def _between(bound: FloatArray, ends: FloatArray) -> FloatArray:
    start, end = project(ends, bound)[0]
    return cut(bound, start, end) if end - start > 1e-3 else along(bound, np.array([start, end]))
