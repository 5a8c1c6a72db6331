"""Text of a planned net: SUMO's net.xml."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.parts import KEY, parts_text
from scex_sumo.converters.net.sumo_net import DECIMALS, shape_text
from scex_sumo.geometry.bounds import mean_line
from scex_sumo.geometry.polylines import samples
from scex_sumo.lanelet2sumo.plan.elements import (
    WALKING_SPEED_MPS,
    Connection,
    NetLane,
    NetLayout,
    Node,
    Programme,
    Walks,
)
from scex_sumo.road import Georeference
from scex_sumo.roads.conflicts import CLEARANCE_M, STEP_M, LineSamples, close_span, lines_cross, opposed

# Traffic light and link index by internal lane or crossing.
Lights: TypeAlias = Mapping[str, tuple[str, int]]

EXACT = 9  # decimals of lanes' shapes: drivers on a net that is read back shall plan as on its map
ROOT = '<net version="1.20" junctionCornerDetail="5"{} limitTurnSpeed="-1.00">'
NOBODY = "custom2"  # a class that no vehicle has
# Of a junction, by the first of these states among its links.
KINDS = {"Z": "zipper", "w": "allway_stop", "s": "priority_stop", "m": "priority", "=": "right_before_left"}
INSET_M = 0.5  # SUMO takes a stretch for real only if it begins or ends strictly within the lane

_Span: TypeAlias = tuple[float, float]  # m along an internal lane


def net_text(
    layout: NetLayout, programmes: Sequence[Programme], place: Georeference | None, walks: Walks
) -> str:
    """Return the whole file; with ``place`` SUMO's tools can show the net on a map of the world."""
    lights = {c.internal.name: (p.name, k) for p in programmes for k, c in enumerate(p.connections)}
    lights |= {n: (p.name, len(p.connections) + k) for p in programmes for k, n in enumerate(p.crossings)}
    lanes = [lane for edge in layout.edges for lane in edge.lanes] + [walk.lane for walk in walks.sidewalks]
    points = np.vstack([lane.shape for lane in lanes])
    nodes = sorted(layout.nodes, key=lambda node: node.name)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        "",
        ROOT.format(' walkingareas="true"' * bool(walks.areas)),
        _location(np.concatenate([points.min(axis=0), points.max(axis=0)]), place),
        *_edges(layout, nodes, walks),
        *_programmes(programmes),
        *_junctions(nodes, lights, walks),
        *_connections(nodes, lights, walks),
        "</net>",
        "",
    ]
    return "\n".join(lines)


def _programmes(programmes: Iterable[Programme]) -> Iterator[str]:
    for programme in programmes:
        name = f'id="{programme.name}" type="static" programID="{programme.programme}"'
        yield f'    <tlLogic {name} offset="0">'
        yield from (f'        <phase duration="{s:g}" state="{state}"/>' for s, state in programme.phases)
        yield "    </tlLogic>"


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


def _lane(lane: NetLane, index: int = 0, *, bans: bool = False) -> str:
    allow = f' allow="{lane.allow}"' if lane.allow else ""
    sides = (("changeLeft", lane.change_left), ("changeRight", lane.change_right)) if bans else ()
    change = "".join(f' {side}="{NOBODY}"' for side, free in sides if not free)
    return (
        f'        <lane id="{lane.name}" index="{index}"{allow}{change} speed="{lane.speed:.4f}"'
        f' length="{max(lane.length, 0.1):.{DECIMALS}f}" width="{lane.width:.2f}"'
        f' shape="{shape_text(lane.shape, EXACT)}">'
        f'<param key="{KEY}" value="{parts_text(lane.parts)}"/></lane>'
    )


def _walking_lane(name: str, speed: float, length: str, width: float, shape: FloatArray) -> str:
    return (
        f'        <lane id="{name}" index="0" allow="pedestrian" speed="{speed}" length="{length}"'
        f' width="{width:.2f}" shape="{shape_text(shape)}"/>'
    )


def _edge(name: str, attributes: str, *lanes: str) -> list[str]:
    return [f'    <edge id="{name}" {attributes}>', *lanes, "    </edge>"]


def _edges(layout: NetLayout, nodes: Iterable[Node], walks: Walks) -> Iterator[str]:
    between = 'from="{}" to="{}" priority="-1" spreadType="center"'
    for internal in (c.internal for node in nodes for c in node.connections):
        yield from _edge(internal.edge, 'function="internal"', _lane(internal))
    for crossing in walks.crossings:
        about = f'function="crossing" crossingEdges="{" ".join(crossing.edges)}"'
        yield from _edge(crossing.lane.edge, about, _footway(crossing.lane))
    for name, outline in walks.areas.items():
        area = _walking_lane(f"{name}_0", WALKING_SPEED_MPS, "1.00", 2.0, outline)
        yield from _edge(name, 'function="walkingarea"', area)
    for edge in layout.edges:
        lanes = [_lane(lane, k, bans=len(edge.lanes) > 1) for k, lane in enumerate(edge.lanes)]
        # SUMO itself uses the lanes; exports use their mean line.
        shape = shape_text(mean_line([lane.shape for lane in edge.lanes]))
        about = f'{between.format(edge.start, edge.end)} shape="{shape}"'
        yield from _edge(edge.name, about, *lanes)
    for walk in walks.sidewalks:
        yield from _edge(walk.lane.edge, between.format(*walk.nodes), _footway(walk.lane))


def _footway(lane: NetLane) -> str:
    length = f"{max(lane.length, 0.1):.{DECIMALS}f}"
    return _walking_lane(lane.name, lane.speed, length, lane.width, lane.shape)


def _junction(name: str, kind: str, shape: FloatArray, incoming: Iterable[str], inner: Iterable[str]) -> str:
    x, y = shape.mean(axis=0)
    return (
        f'    <junction id="{name}" type="{kind}" x="{x:.{DECIMALS}f}" y="{y:.{DECIMALS}f}"'
        f' incLanes="{" ".join(incoming)}" intLanes="{" ".join(inner)}" shape="{shape_text(shape)}"'
    )


def _junctions(nodes: Iterable[Node], lights: Lights, walks: Walks) -> Iterator[str]:
    for node in nodes:
        links, crossings = node.connections, walks.at(node.name)
        incoming = [*node.incoming, *walks.incoming(node.name)]
        inner = [c.internal.name for c in links] + [crossing.lane.name for crossing in crossings]
        head = _junction(node.name, _type(node, lights), node.shape, incoming, inner)
        yield f'{head} customShape="1">' if links else f"{head}/>"
        for index, link in enumerate(links):
            walked = {len(links) + k: c.marked for k, c in enumerate(crossings) if index in c.crossed}
            first = {k for k, marked in walked.items() if marked}
            yield _request(index, link.response | first, link.foes | walked.keys(), len(inner))
        for k, crossing in enumerate(crossings if links else ()):
            crossed = set(crossing.crossed)
            response = set() if crossing.marked else crossed
            yield _request(len(links) + k, response, crossed, len(inner))
        if links:
            yield "    </junction>"
    for name, outline in walks.nodes.items():
        yield f"{_junction(name, 'dead_end', outline, walks.incoming(name), ())}/>"


def _request(index: int, response: set[int], foes: set[int], size: int) -> str:
    written = f'response="{_bits(response, size)}" foes="{_bits(foes, size)}"'
    return f'        <request index="{index}" {written} cont="0"/>'


def _bits(indices: set[int], count: int) -> str:
    """Format SUMO's bit string: index 0 is the rightmost character."""
    return "".join("1" if i in indices else "0" for i in reversed(range(count)))


def _direction(bend: float) -> str:
    """Return SUMO's letter for a change of heading, rad."""
    degrees = math.degrees(bend)
    if abs(degrees) < 25:
        return "s"
    if abs(degrees) > 165:
        return "t"
    letter = "l" if degrees > 0 else "r"
    return letter.upper() if abs(degrees) < 50 else letter


def _type(node: Node, lights: Lights) -> str:
    if any(connection.internal.name in lights for connection in node.connections):
        return "traffic_light"
    states = {connection.state for connection in node.connections}
    other = "priority" if states else "dead_end"
    return next((kind for state, kind in KINDS.items() if state in states), other)


def _connections(nodes: Iterable[Node], lights: Lights, walks: Walks) -> Iterator[str]:
    written: dict[str, list[str]] = {}
    for node in nodes:
        for link, foe, span in _conflict_stretches(node):
            stretch = f'startPos="{span[0]:.2f}" endPos="{span[1]:.2f}"'
            written.setdefault(link.internal.name, []).append(f"        <conflict {_ends(foe)} {stretch}/>")
    every = [c for node in nodes for c in node.connections]
    for c in every:
        via, light = f' via="{c.internal.name}"', _light(c.internal.name, lights)
        state = ("o" if c.response else "O") if light else c.state
        head = f'    <connection {_ends(c)}{via}{light} dir="{_direction(c.bend)}" state="{state}"'
        conflicts = written.get(c.internal.name, ())
        yield from [f"{head}>", *conflicts, "    </connection>"] if conflicts else [f"{head}/>"]
    for c in every:
        yield _way(c.internal.edge, c.to_edge, c.to_lane, turn=_direction(c.bend))
    for crossing in walks.crossings:
        light, state = _light(crossing.lane.edge, lights), "M" if crossing.marked else "m"
        yield _way(crossing.areas[0], crossing.lane.edge, light=light, state=state)
        yield _way(crossing.lane.edge, crossing.areas[1])
    for walk in walks.sidewalks:
        for ends in ((walk.areas[0], walk.lane.edge), (walk.lane.edge, walk.areas[1])):
            if all(ends):
                yield _way(*ends)


def _light(name: str, lights: Lights) -> str:
    return ' tl="{}" linkIndex="{}"'.format(*lights[name]) if name in lights else ""


def _ends(c: Connection) -> str:
    return f'from="{c.from_edge}" to="{c.to_edge}" fromLane="{c.from_lane}" toLane="{c.to_lane}"'


def _way(start: str, end: str, lane: int = 0, *, light: str = "", turn: str = "s", state: str = "M") -> str:
    ends = f'from="{start}" to="{end}" fromLane="0" toLane="{lane}"'
    return f'    <connection {ends}{light} dir="{turn}" state="{state}"/>'


def _conflict_stretches(node: Node) -> Iterator[tuple[Connection, Connection, _Span]]:
    """Yield pairs of foes whose conflict SUMO cannot find, with its stretch on the first connection, m.

    SUMO looks for the point where two internal lanes cross; lanes that pass close by have none.
    """
    links = node.connections
    sampled = {i: samples(c.internal.shape, STEP_M) for i, c in enumerate(links) if c.foes}
    spans: dict[tuple[int, int], _Span] = {}
    for i in sampled:
        for j in sorted(links[i].foes):
            if i < j:
                both = _unseen(links[i], links[j], sampled[i], sampled[j])
                spans |= zip(((i, j), (j, i)), both, strict=True) if both else ()
            if (i, j) in spans:
                yield links[i], links[j], spans[i, j]


def _unseen(a: Connection, b: Connection, on_a: LineSamples, on_b: LineSamples) -> tuple[_Span, _Span] | None:
    if (a.to_edge, a.to_lane) == (b.to_edge, b.to_lane):
        return None  # SUMO knows how to merge
    span = _close(a.internal, b.internal, on_a)
    other = _close(b.internal, a.internal, on_b) if span is not None else None
    if span is None or other is None:
        return None
    crossing = lines_cross(a.internal.shape, b.internal.shape)
    written = not crossing or opposed(a.internal.shape, b.internal.shape, span, other)
    return (span, other) if written else None


def _close(lane: NetLane, other: NetLane, on_lane: LineSamples) -> _Span | None:
    clearance = min(CLEARANCE_M, 0.45 * (lane.width + other.width))
    near = close_span(on_lane, other.shape, clearance)
    if near is None:
        return None
    inset = min(INSET_M, lane.length / 4)
    start, end = max(near[0], inset), min(near[1], lane.length - inset)
    return (start, end) if end > start else None
