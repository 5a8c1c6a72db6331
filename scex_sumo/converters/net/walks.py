"""Pedestrian part of a SUMO net: crossings in junctions, walking areas and sidewalks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import TypeAlias

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.elements import Connection, NetLane, NetLayout
from scex_sumo.converters.net.footways import Footway, corners
from scex_sumo.converters.net.topology import Topology
from scex_sumo.geometry.polylines import cut, heading, length_of

_Across: TypeAlias = tuple[str, tuple[int, ...], tuple[str, ...]]  # junction, its links, edges at them

SPEED_MPS = 2.78  # SUMO's own for sidewalks
TRIM_M = 0.75  # what a walking area takes of each footway that ends at it
STUB_M = 3.0  # of sidewalk at a crosswalk's free end: SUMO's people come from sidewalks


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """A crosswalk across links of one junction.

    Attributes:
        start: walking area at its beginning.
        end: walking area at its end.
        crossed: indices of the junction's links that run over it.
        marked: whether vehicles give way there; elsewhere people do.
    """

    node: str
    lane: NetLane
    start: str
    end: str
    crossed: tuple[int, ...]
    edges: tuple[str, ...]
    marked: bool

    @property
    def name(self) -> str:
        """SUMO's edge."""
        return self.lane.name.removesuffix("_0")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sidewalk:
    lane: NetLane
    nodes: tuple[str, str]
    areas: tuple[str, str]

    @property
    def name(self) -> str:
        return self.lane.name.removesuffix("_0")


@dataclass(frozen=True, kw_only=True, eq=False)
class Walks:
    """Pedestrian part of a net; ``areas`` and ``nodes`` hold outlines by name."""

    crossings: tuple[Crossing, ...]
    areas: Mapping[str, FloatArray]
    sidewalks: tuple[_Sidewalk, ...]
    nodes: Mapping[str, FloatArray]

    def at(self, node: str) -> list[Crossing]:
        """Crossings of a junction."""
        return [c for c in self.crossings if c.node == node]

    def incoming(self, node: str) -> list[str]:
        """Return lanes for people that lead into a junction."""
        ending = [s.lane.name for s in self.sidewalks if s.nodes[1] == node]
        return [*ending, *dict.fromkeys(f"{c.start}_0" for c in self.at(node))]

    def places(self) -> Iterator[tuple[str, list[tuple[int, float]]]]:
        """Each lane for people, with the lanelet under it and its order along that lanelet."""
        for k, lane in enumerate(walk.lane for walks in (self.crossings, self.sidewalks) for walk in walks):
            yield lane.name, [(lanelet, float(k)) for lanelet in lane.lanelets]


NO_WALKS = Walks(crossings=(), areas={}, sidewalks=(), nodes={})


def plan_walks(ways: Sequence[Footway], topology: Topology, layout: NetLayout) -> Walks:
    """Put a map's footways into the net of its vehicle lanes."""
    return _Plan(ways, topology, layout).walks() if ways else NO_WALKS


class _Plan:
    def __init__(self, ways: Sequence[Footway], topology: Topology, layout: NetLayout) -> None:
        across = {way.name: _across(way, topology, layout) for way in ways}
        self._across = {name: found for name, found in across.items() if found is not None}
        owners = {p: self._across[w.name][0] for w in ways if w.name in self._across for p in w.places}
        crosswalks = [way for way in ways if way.name in self._across]
        sidewalks = [way for way in ways if way.name not in self._across]
        fresh = count(max(place for way in ways for place in way.places) + 1)
        self._ways = [*crosswalks, *_halved(sidewalks, owners, fresh), *_stubs(crosswalks, ways, fresh)]
        ends = [place for way in self._ways for place in way.places]
        self._node = {place: owners.get(place, f"p{place}") for place in sorted(set(ends))}
        numbers: dict[str, Iterator[int]] = {node: count() for node in self._node.values()}
        self._area = {p: f":{n}_w{next(numbers[n])}" for p, n in self._node.items() if ends.count(p) > 1}

    def walks(self) -> Walks:
        crossings: list[Crossing] = []
        sidewalks: list[_Sidewalk] = []
        corner: dict[int, list[FloatArray]] = {}
        numbers: dict[str, Iterator[int]] = {node: count() for node in self._node.values()}
        for way in self._ways:
            areas = (self._area.get(way.places[0], ""), self._area.get(way.places[1], ""))
            shape = _trimmed(way.shape, areas)
            for place, end in zip(way.places, (False, True), strict=True):
                corner.setdefault(place, []).append(corners(shape, way.width, end=end))
            lane = NetLane(
                name=f"{way.name}_0",
                shape=shape,
                length=length_of(shape),
                width=way.width,
                speed=SPEED_MPS,
                lanelets=() if way.lanelet is None else (way.lanelet,),
                allow="pedestrian",
            )
            if way.name in self._across:
                node, links, edges = self._across[way.name]
                name = f":{node}_c{next(numbers[node])}"
                lane = replace(lane, name=f"{name}_0")
                crossings.append(
                    Crossing(
                        node=node,
                        lane=lane,
                        start=areas[0],
                        end=areas[1],
                        crossed=links,
                        edges=edges,
                        marked=way.marked,
                    )
                )
            else:
                nodes = (self._node[way.places[0]], self._node[way.places[1]])
                sidewalks.append(_Sidewalk(lane=lane, nodes=nodes, areas=areas))
        return Walks(
            crossings=tuple(sorted(crossings, key=lambda c: c.lane.name)),
            areas={name: _hull(corner[place]) for place, name in self._area.items()},
            sidewalks=tuple(sidewalks),
            nodes={n: _hull(corner[place]) for place, n in self._node.items() if n == f"p{place}"},
        )


def _across(way: Footway, topology: Topology, layout: NetLayout) -> _Across | None:
    pieces = {piece for lane, span in way.crossed for piece in topology.pieces_on(lane, *span)}
    for node in layout.nodes if pieces else ():
        links = [k for k, c in enumerate(node.connections) if pieces & set(c.link.path.inside)]
        if links:
            edges = dict.fromkeys(_nearer_edge(node.connections[k], way.shape) for k in links)
            return node.name, tuple(links), tuple(edges)
    return None


def _nearer_edge(link: Connection, crosswalk: FloatArray) -> str:
    line = shapely.LineString(crosswalk)
    first, last = (line.distance(shapely.Point(link.internal.shape[k])) for k in (0, -1))
    return link.from_edge if first <= last else link.to_edge


def _halved(ways: Sequence[Footway], owners: Mapping[int, str], fresh: Iterator[int]) -> Iterator[Footway]:
    for way in ways:
        one, other = way.places
        if one not in owners or owners[one] != owners.get(other):
            yield way
            continue
        middle, half = next(fresh), length_of(way.shape) / 2
        shapes = cut(way.shape, 0.0, half), cut(way.shape, half, 2 * half)
        for k, (shape, places) in enumerate(zip(shapes, ((one, middle), (middle, other)), strict=True)):
            yield replace(way, name=f"{way.name}#{'ab'[k]}", shape=shape, places=places)


def _stubs(crosswalks: Sequence[Footway], ways: Sequence[Footway], fresh: Iterator[int]) -> Iterator[Footway]:
    ends = [place for way in ways for place in way.places]
    for way in crosswalks:
        for k, (place, tip, angle) in enumerate(
            (
                (way.places[0], way.shape[0], heading(way.shape, end=False) + math.pi),
                (way.places[1], way.shape[-1], heading(way.shape, end=True)),
            )
        ):
            if ends.count(place) == 1:
                outer = tip + STUB_M * np.array([math.cos(angle), math.sin(angle)])
                yield Footway(
                    name=f"{way.name}#{k}",
                    lanelet=None,
                    shape=np.array([outer, tip]),
                    width=way.width,
                    places=(next(fresh), place),
                )


def _trimmed(shape: FloatArray, areas: tuple[str, str]) -> FloatArray:
    length = length_of(shape)
    off = min(TRIM_M, length / 4)
    return cut(shape, off * bool(areas[0]), length - off * bool(areas[1]))


def _hull(points: Sequence[FloatArray]) -> FloatArray:
    hull = shapely.MultiPoint(np.vstack(points)).convex_hull
    return np.asarray(hull.exterior.coords[:-1] if hull.geom_type == "Polygon" else hull.coords)
