"""Text of a planned net: SUMO's net.xml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.lanelets import KEY, parts_text
from scex_sumo.converters.net.plan.layout import (
    DECIMALS,
    EXACT,
    Connection,
    Edge,
    NetLane,
    NetLayout,
    Node,
    shape_text,
)
from scex_sumo.converters.net.plan.lights import Programme
from scex_sumo.converters.net.plan.pedestrians import NO_WALKS, SPEED_MPS, Walks
from scex_sumo.converters.net.plan.right_of_way import bits, direction
from scex_sumo.road import Georeference
from scex_sumo.roads.conflicts import CLEARANCE_M, SampledLine, lines_cross, opposed

# Traffic light and link index by internal lane or crossing.
Lights: TypeAlias = Mapping[str, tuple[str, int]]

HEADER = '<?xml version="1.0" encoding="UTF-8"?>'
ROOT = '<net version="1.20" junctionCornerDetail="5" limitTurnSpeed="-1.00">'
# No vehicle has this class.
NOBODY = "custom2"


def net_text(
    layout: NetLayout,
    programmes: Sequence[Programme] = (),
    place: Georeference | None = None,
    walks: Walks = NO_WALKS,
) -> str:
    """Return the whole file; with ``place`` SUMO's tools can show the net on a map of the world."""
    lights = {c.internal.name: (p.name, k) for p in programmes for k, c in enumerate(p.connections)}
    lights |= {n: (p.name, len(p.connections) + k) for p in programmes for k, n in enumerate(p.crossings)}
    root = ROOT.replace(" limit", ' walkingareas="true" limit') if walks.areas else ROOT
    return "\n".join([HEADER, "", root, *_body(layout, programmes, lights, place, walks), "</net>", ""])


def _body(
    layout: NetLayout,
    programmes: Sequence[Programme],
    lights: Lights,
    place: Georeference | None,
    walks: Walks,
) -> Iterator[str]:
    lanes = [lane for edge in layout.edges for lane in edge.lanes]
    points = np.vstack([lane.shape for lane in (*lanes, *(walk.lane for walk in walks.sidewalks))])
    yield _location(np.concatenate([points.min(axis=0), points.max(axis=0)]), place)
    nodes = sorted(layout.nodes, key=lambda node: node.name)
    told: dict[str, list[str]] = {}
    for node in nodes:
        for one, other, span in _conflict_stretches(node):
            told.setdefault(one.internal.name, []).append(_conflict(other, span))
    for node in nodes:
        for connection in node.connections:
            yield from _internal(connection.internal)
    yield from _crossing_edges(walks)
    for edge in layout.edges:
        yield from _edge(edge)
    yield from _sidewalk_edges(walks)
    for programme in programmes:
        name = f'id="{programme.name}" type="static" programID="{programme.programme}"'
        yield f'    <tlLogic {name} offset="0">'
        for seconds, state in programme.phases:
            yield f'        <phase duration="{seconds:g}" state="{state}"/>'
        yield "    </tlLogic>"
    for node in nodes:
        yield from _junction(node, lights, walks)
    yield from _pedestrian_junctions(walks)
    for node in nodes:
        for connection in node.connections:
            yield from _connection(connection, lights, told.get(connection.internal.name, ()))
    for node in nodes:
        for connection in node.connections:
            yield _exit(connection)
    yield from _pedestrian_connections(walks, lights)


def _location(corners: FloatArray, place: Georeference | None) -> str:
    boundary = ",".join(f"{v:.2f}" for v in corners)
    if place is None:
        offset, original, projection = "0.00,0.00", boundary, "!"
    else:
        offset = f"{-place.east_m:.4f},{-place.north_m:.4f}"
        away = np.array([place.east_m, place.north_m] * 2)
        original = ",".join(f"{v:.2f}" for v in corners + away)
        projection = place.projection
    return (
        f'    <location netOffset="{offset}" convBoundary="{boundary}" origBoundary="{original}"'
        f' projParameter="{projection}"/>'
    )


def _lane(lane: NetLane, index: int, *, bans: bool) -> str:
    allow = f' allow="{lane.allow}"' if lane.allow else ""
    change = ""
    if bans:
        change = "" if lane.change_left else f' changeLeft="{NOBODY}"'
        change += "" if lane.change_right else f' changeRight="{NOBODY}"'
    return (
        f'        <lane id="{lane.name}" index="{index}"{allow}{change} speed="{lane.speed:.4f}"'
        f' length="{max(lane.length, 0.1):.{DECIMALS}f}" width="{lane.width:.2f}"'
        f' shape="{shape_text(lane.shape, EXACT)}">'
        f'<param key="{KEY}" value="{parts_text(lane.parts)}"/></lane>'
    )


def _internal(lane: NetLane) -> Iterator[str]:
    yield f'    <edge id="{lane.name.rsplit("_", 1)[0]}" function="internal">'
    yield _lane(lane, 0, bans=False)
    yield "    </edge>"


def _edge(edge: Edge) -> Iterator[str]:
    yield (
        f'    <edge id="{edge.name}" from="{edge.start}" to="{edge.end}" priority="-1" spreadType="center"'
        f' shape="{shape_text(edge.shape)}">'
    )
    for index, lane in enumerate(edge.lanes):
        yield _lane(lane, index, bans=len(edge.lanes) > 1)
    yield "    </edge>"


def _junction(node: Node, lights: Lights, walks: Walks) -> Iterator[str]:
    x, y = node.shape.mean(axis=0)
    links, crossings = [connection.link for connection in node.connections], walks.at(node.name)
    incoming = [*node.incoming, *walks.incoming(node.name)]
    inner = [c.internal.name for c in node.connections] + [crossing.lane.name for crossing in crossings]
    head = (
        f'    <junction id="{node.name}" type="{_type(node, lights)}"'
        f' x="{x:.{DECIMALS}f}" y="{y:.{DECIMALS}f}" incLanes="{" ".join(incoming)}"'
        f' intLanes="{" ".join(inner)}" shape="{shape_text(node.shape)}"'
    )
    if not links:
        yield f"{head}/>"
        return
    yield f'{head} customShape="1">'
    size = len(inner)
    for index, link in enumerate(links):
        walked = {len(links) + k: c.marked for k, c in enumerate(crossings) if index in c.crossed}
        first = {k for k, marked in walked.items() if marked}
        yield _request(index, link.response | first, link.foes | walked.keys(), size)
    for k, crossing in enumerate(crossings):
        crossed = set(crossing.crossed)
        yield _request(len(links) + k, set() if crossing.marked else crossed, crossed, size)
    yield "    </junction>"


def _request(index: int, response: set[int], foes: set[int], size: int) -> str:
    told = f'response="{bits(response, size)}" foes="{bits(foes, size)}"'
    return f'        <request index="{index}" {told} cont="0"/>'


def _type(node: Node, lights: Lights) -> str:
    if any(connection.internal.name in lights for connection in node.connections):
        return "traffic_light"
    states = {connection.link.state for connection in node.connections}
    if not states:
        return "dead_end"
    kinds = {
        "Z": "zipper",
        "w": "allway_stop",
        "s": "priority_stop",
        "m": "priority",
        "=": "right_before_left",
    }
    return next((kind for state, kind in kinds.items() if state in states), "priority")


def _connection(c: Connection, lights: Lights, conflicts: Sequence[str]) -> Iterator[str]:
    light, state = "", c.link.state
    if c.internal.name in lights:
        name, index = lights[c.internal.name]
        light, state = f' tl="{name}" linkIndex="{index}"', "o" if c.link.response else "O"
    head = (
        f'    <connection from="{c.from_edge}" to="{c.to_edge}" fromLane="{c.from_lane}" toLane="{c.to_lane}"'
        f' via="{c.internal.name}"{light} dir="{direction(c.link.bend)}" state="{state}"'
    )
    if not conflicts:
        yield f"{head}/>"
        return
    yield f"{head}>"
    yield from conflicts
    yield "    </connection>"


def _conflict(other: Connection, span: tuple[float, float]) -> str:
    return (
        f'        <conflict from="{other.from_edge}" to="{other.to_edge}" fromLane="{other.from_lane}"'
        f' toLane="{other.to_lane}" startPos="{span[0]:.2f}" endPos="{span[1]:.2f}"/>'
    )


def _exit(c: Connection) -> str:
    return (
        f'    <connection from="{c.internal.name.rsplit("_", 1)[0]}" to="{c.to_edge}" fromLane="0"'
        f' toLane="{c.to_lane}" dir="{direction(c.link.bend)}" state="M"/>'
    )


def _crossing_edges(walks: Walks) -> Iterator[str]:
    for crossing in walks.crossings:
        edges = " ".join(crossing.edges)
        yield f'    <edge id="{crossing.name}" function="crossing" crossingEdges="{edges}">'
        yield _walking_lane(crossing.lane)
        yield "    </edge>"
    for name, outline in walks.areas.items():
        yield f'    <edge id="{name}" function="walkingarea">'
        yield (
            f'        <lane id="{name}_0" index="0" allow="pedestrian" speed="{SPEED_MPS}" length="1.00"'
            f' width="2.00" shape="{shape_text(outline)}"/>'
        )
        yield "    </edge>"


def _sidewalk_edges(walks: Walks) -> Iterator[str]:
    for walk in walks.sidewalks:
        start, end = walk.nodes
        yield f'    <edge id="{walk.name}" from="{start}" to="{end}" priority="-1" spreadType="center">'
        yield _walking_lane(walk.lane)
        yield "    </edge>"


def _pedestrian_junctions(walks: Walks) -> Iterator[str]:
    for name, outline in walks.nodes.items():
        x, y = outline.mean(axis=0)
        yield (
            f'    <junction id="{name}" type="dead_end" x="{x:.{DECIMALS}f}" y="{y:.{DECIMALS}f}"'
            f' incLanes="{" ".join(walks.incoming(name))}" intLanes="" shape="{shape_text(outline)}"/>'
        )


def _pedestrian_connections(walks: Walks, lights: Mapping[str, tuple[str, int]]) -> Iterator[str]:
    for crossing in walks.crossings:
        light = ""
        if crossing.name in lights:
            name, index = lights[crossing.name]
            light = f' tl="{name}" linkIndex="{index}"'
        yield _way(crossing.start, crossing.name, light, state="M" if crossing.marked else "m")
        yield _way(crossing.name, crossing.end)
    for walk in walks.sidewalks:
        start, end = walk.areas
        if start:
            yield _way(start, walk.name)
        if end:
            yield _way(walk.name, end)


def _walking_lane(lane: NetLane) -> str:
    return (
        f'        <lane id="{lane.name}" index="0" allow="{lane.allow}" speed="{lane.speed}"'
        f' length="{max(lane.length, 0.1):.{DECIMALS}f}" width="{lane.width:.2f}"'
        f' shape="{shape_text(lane.shape)}"/>'
    )


def _way(start: str, end: str, light: str = "", state: str = "M") -> str:
    return (
        f'    <connection from="{start}" to="{end}" fromLane="0" toLane="0"{light} dir="s" state="{state}"/>'
    )


# SUMO takes a stretch for real only if it begins or ends strictly within the lane.
INSET_M = 0.5

_Span: TypeAlias = tuple[float, float]  # m along an internal lane


def _conflict_stretches(node: Node) -> Iterator[tuple[Connection, Connection, _Span]]:
    """Yield pairs of foes whose conflict SUMO cannot find, with its stretch on the first connection, m.

    SUMO looks for the point where two internal lanes cross; lanes that pass close by have none.
    """
    links = node.connections
    sampled = {i: SampledLine.of(c.internal.shape) for i, c in enumerate(links) if c.link.foes}
    spans: dict[tuple[int, int], _Span] = {}
    for i in sampled:
        for j in sorted(links[i].link.foes):
            if i < j:
                both = _unseen(links[i], links[j], sampled[i], sampled[j])
                spans |= zip(((i, j), (j, i)), both, strict=True) if both else ()
            if (i, j) in spans:
                yield links[i], links[j], spans[i, j]


def _unseen(a: Connection, b: Connection, on_a: SampledLine, on_b: SampledLine) -> tuple[_Span, _Span] | None:
    if (a.to_edge, a.to_lane) == (b.to_edge, b.to_lane):
        return None  # SUMO knows how to merge
    span = _close(a.internal, b.internal, on_a, on_b)
    other = _close(b.internal, a.internal, on_b, on_a) if span is not None else None
    if span is None or other is None:
        return None
    crossing = lines_cross(a.internal.shape, b.internal.shape)
    told = not crossing or opposed(a.internal.shape, b.internal.shape, span, other)
    return (span, other) if told else None


def _close(lane: NetLane, other: NetLane, sampled: SampledLine, beside: SampledLine) -> _Span | None:
    clearance = min(CLEARANCE_M, 0.45 * (lane.width + other.width))
    near = np.flatnonzero(sampled.near(beside, clearance))
    if not len(near):
        return None
    inset = min(INSET_M, lane.length / 4)
    start, end = max(float(sampled.s[near[0]]), inset), min(float(sampled.s[near[-1]]), lane.length - inset)
    return (start, end) if end > start else None
