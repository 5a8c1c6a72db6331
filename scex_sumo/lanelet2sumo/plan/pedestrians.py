"""Pedestrian part of a SUMO net: crossings in junctions, walking areas and sidewalks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count
from typing import TypeAlias

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.geometry.polylines import cut, heading, length_of
from scex_sumo.lanelet2sumo.plan.elements import (
    WALKING_SPEED_MPS,
    Connection,
    Crossing,
    NetLane,
    NetLayout,
    Sidewalk,
    Walks,
)
from scex_sumo.lanelet2sumo.plan.footways import (
    MIN_SINE,
    OVER_M,
    PASS_M,
    TIP_M,
    TWO_ABREAST_M,
    Footway,
    lengthened,
    slant,
)
from scex_sumo.lanelet2sumo.plan.layout import corners, hull
from scex_sumo.lanelet2sumo.topology.graph import Topology

# Line and width of a crossing, and by how much it is longer than the crosswalk at each end, m.
_Over: TypeAlias = tuple[FloatArray, float, tuple[float, float]]
_Across: TypeAlias = tuple[str, tuple[int, ...], tuple[str, ...]]  # junction, its links, edges at them

ASIDE_M = 0.6  # along a slanted crossing, between people at its sides and those in its middle
ISLAND_END_M = 0.25  # of the shortest walking area between two crosswalks
TRIM_M = 0.75  # what a walking area takes of each footway that ends at it
STUB_M = 3.0  # of sidewalk at a crosswalk's free end: SUMO's people come from sidewalks


def plan_walks(footways: Sequence[Footway], topology: Topology, layout: NetLayout) -> Walks:
    """Put a map's footways into the net of its vehicle lanes."""
    met = {footway.name: _across(footway, topology, layout) for footway in footways}
    across = {name: place_across for name, place_across in met.items() if place_across is not None}
    owners = {
        place: across[footway.name][0]
        for footway in footways
        if footway.name in across
        for place in footway.places
    }
    crosswalks = [footway for footway in footways if footway.name in across]
    fresh = count(max((place for footway in footways for place in footway.places), default=0) + 1)
    walkways = _halved([footway for footway in footways if footway.name not in across], owners, fresh)
    footways = [*crosswalks, *walkways, *_stubs(crosswalks, footways, fresh)]
    ends = [place for footway in footways for place in footway.places]
    node = {place: owners.get(place, f"p{place}") for place in sorted(set(ends))}
    numbers, crossed = ({name: count() for name in node.values()} for _ in range(2))
    area = {p: f":{n}_w{next(numbers[n])}" for p, n in node.items() if ends.count(p) > 1}
    crossings: list[Crossing] = []
    sidewalks: list[Sidewalk] = []
    corner: dict[int, list[FloatArray]] = {}
    over, met_twice = dict[str, _Over](), [place for footway in crosswalks for place in footway.places]
    for footway in crosswalks:
        shared = [met_twice.count(place) > 1 for place in footway.places]
        over[footway.name] = _over_lanes(footway, across[footway.name], layout, shared)
    beyond = {
        p: reach
        for footway in crosswalks
        for p, reach in zip(footway.places, over[footway.name][2], strict=True)
    }
    for footway in footways:
        start, end = footway.places
        areas, name = (area.get(start, ""), area.get(end, "")), footway.name
        if footway.name in over:
            shape, width, _ = over[footway.name]
            junction = across[footway.name][0]
            name = f":{junction}_c{next(crossed[junction])}"
        else:
            size, width, trims = length_of(footway.shape), footway.width, list[float]()
            for place, there in zip(footway.places, areas, strict=True):
                most = size / 2 - TRIM_M / 2 if beyond.get(place) else size / 4
                trims.append(min(TRIM_M + beyond.get(place, 0.0), most) * bool(there))
            shape = cut(footway.shape, trims[0], size - trims[1])
        for place, last in ((start, False), (end, True)):
            corner.setdefault(place, []).append(corners(shape, width, end=last, reach=TIP_M))
        lane = NetLane(
            name=f"{name}_0",
            shape=shape,
            length=length_of(shape),
            width=width,
            speed=WALKING_SPEED_MPS,
            starts=tuple((lanelet, 0.0) for lanelet in footway.lanelets),
            allow="pedestrian",
        )
        if footway.name in across:
            crossings.append(Crossing(*across[footway.name], lane=lane, areas=areas, marked=footway.marked))
        else:
            sidewalks.append(Sidewalk(lane=lane, nodes=(node[start], node[end]), areas=areas))
    return Walks(
        crossings=tuple(sorted(crossings, key=lambda c: c.lane.name)),
        areas={name: hull(corner[place]) for place, name in area.items()},
        sidewalks=tuple(sidewalks),
        nodes={n: hull(corner[place]) for place, n in node.items() if n == f"p{place}"},
    )


def _across(footway: Footway, topology: Topology, layout: NetLayout) -> _Across | None:
    pieces = {piece for lane, span in footway.crossed for piece in topology.pieces_on(lane, *span)}
    for node in layout.nodes if pieces else ():
        links = [k for k, c in enumerate(node.connections) if pieces & set(c.path.inside)]
        if links:
            edges = dict.fromkeys(_nearer_edge(node.connections[k], footway.shape) for k in links)
            return node.name, tuple(links), tuple(edges)
    return None


def _over_lanes(footway: Footway, across: _Across, layout: NetLayout, shared: Sequence[bool]) -> _Over:
    """Return the line and the width of a crossing, and by how much it is longer than the crosswalk, m.

    Walking areas take the ends of a crosswalk, but nothing of the lanes, except where it is ``shared`` with
    another crosswalk. SUMO's cars do not see people on a crossing whose line ends before the middle of their
    lane, nor people aside on a wide crossing that is slanted to it.
    """
    size, width = length_of(footway.shape), footway.width
    off = min(TRIM_M, size / 4)
    low, high = off, size - off
    least, most = (min(ISLAND_END_M, off) if both else -OVER_M for both in shared)
    line = lengthened(footway.shape)
    connections = next(node.connections for node in layout.nodes if node.name == across[0])
    for k in across[1] if footway.marked else ():
        lane = connections[k].internal
        met = line.intersection(shapely.LineString(lane.shape))
        for point in shapely.points(shapely.get_coordinates(met)):
            sine, cosine = slant(line, shapely.LineString(lane.shape), point)
            if sine < MIN_SINE:
                continue
            s, reach = float(line.project(point)) - OVER_M, max(lane.width / 2, PASS_M) / sine
            low, high = min(low, s - reach), max(high, s + reach)
            width = min(width, 2 * ASIDE_M * sine / max(cosine, 1e-6))
    low, high = max(low, least), min(high, size - most)
    shape = cut(shapely.get_coordinates(line), low + OVER_M, high + OVER_M)
    return shape, min(max(width, TWO_ABREAST_M), footway.width), (max(-low, 0.0), max(high - size, 0.0))


def _nearer_edge(link: Connection, crosswalk: FloatArray) -> str:
    line = shapely.LineString(crosswalk)
    first, last = (line.distance(shapely.Point(link.internal.shape[k])) for k in (0, -1))
    return link.from_edge if first <= last else link.to_edge


def _halved(
    footways: Sequence[Footway], owners: Mapping[int, str], fresh: Iterator[int]
) -> Iterator[Footway]:
    for footway in footways:
        start, end = footway.places
        if start not in owners or owners[start] != owners.get(end):
            yield footway
            continue
        middle, half = next(fresh), length_of(footway.shape) / 2
        shapes = cut(footway.shape, 0.0, half), cut(footway.shape, half, 2 * half)
        for k, (shape, places) in enumerate(zip(shapes, ((start, middle), (middle, end)), strict=True)):
            yield replace(footway, name=f"{footway.name}#{'ab'[k]}", shape=shape, places=places)


def _stubs(
    crosswalks: Sequence[Footway], footways: Sequence[Footway], fresh: Iterator[int]
) -> Iterator[Footway]:
    places = [place for footway in footways for place in footway.places]
    for footway in crosswalks:
        for k, place in enumerate(footway.places):
            if places.count(place) == 1:
                angle, tip = heading(footway.shape, end=k == 1), footway.shape[-k]
                angle += math.pi if k == 0 else 0.0
                outer = tip + STUB_M * np.array([math.cos(angle), math.sin(angle)])
                name, line, ends = f"{footway.name}#{k}", np.array([outer, tip]), (next(fresh), place)
                yield Footway(name=name, lanelets=(), shape=line, width=footway.width, places=ends)
