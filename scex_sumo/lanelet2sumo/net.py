"""Writer of SUMO nets: a road as edges, connections, nodes and lights.

The net is written directly, not by netconvert, to keep the map's shapes and coordinates.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

from scex_sumo.base.errors import MapError, listed
from scex_sumo.converters.net.parts import lane_places
from scex_sumo.converters.net.reading import allowed_content, read_ends
from scex_sumo.converters.net.sumo_net import LaneTable, WrittenNet
from scex_sumo.converters.xml import net_root
from scex_sumo.geometry.polylines import length_of
from scex_sumo.lanelet2sumo.drawing import extras_text
from scex_sumo.lanelet2sumo.plan.elements import NetLayout, Programme, Walks
from scex_sumo.lanelet2sumo.plan.layout import plan_net
from scex_sumo.lanelet2sumo.text import net_text
from scex_sumo.lanelet2sumo.topology.borders import add_approaches, add_entries
from scex_sumo.lanelet2sumo.topology.cuts import cut_lanes
from scex_sumo.lanelet2sumo.topology.graph import Topology
from scex_sumo.lanelet2sumo.topology.rows import build_rows
from scex_sumo.road import Lane, MapLoss, Road
from scex_sumo.roads.conflicts import Conflict, conflicts

SHORTEST_M = 0.01
JOINED_M = 0.3  # between consecutive bus or bicycle lanes

_TableRow: TypeAlias = tuple[int, str]  # lanelet, SUMO lane


def write_net(road: Road, signals: Path | None = None) -> WrittenNet:
    """Write a road as a SUMO net, with recorded signal phases if given, as `scex.convert`."""
    if road.left_hand:
        from scex_sumo.converters.net.mirror import mirrored_content
        from scex_sumo.roads.mirror import mirrored_road

        image = write_net(mirrored_road(road), signals)
        return replace(image, content=mirrored_content(image.content), drawing=extras_text(road))
    lanes = road.vehicle_lanes
    if not lanes:
        raise MapError(f"{road.name}: no lanelet that cars may drive on; nothing to convert")
    points = sorted(i for i, lane in lanes.items() if length_of(lane.centreline) < SHORTEST_M)
    if points:
        raise MapError(f"{road.name}: lanelets without length: {', '.join(map(str, points[:5]))}; drop them")
    lanes = add_entries(lanes, road.lanes)
    clashes = conflicts(lanes, border_forks=True)
    if (approached := add_approaches(lanes, clashes, road.lanes)).keys() != lanes.keys():
        lanes, clashes = approached, conflicts(approached, border_forks=True)
    layout, walks, lost = _plan(road, lanes, clashes)
    lights, notes = list[Programme](), list[str]()
    if signals is not None or any(rule.kind == "traffic_light" for rule in road.regulations):
        from scex_sumo.lanelet2sumo.plan.lights import plan_lights

        lights, notes = plan_lights(road, lanes, clashes, layout, walks, signals)
    beside = _side_lanes(road)
    layout = NetLayout(edges=layout.edges + beside.edges, nodes=layout.nodes + beside.nodes)
    driven = [lane for edge in layout.edges for lane in edge.lanes] + [c.internal for c in layout.connections]
    walked = [crossing.lane for crossing in walks.crossings] + [walk.lane for walk in walks.sidewalks]
    places = [(lane.name, lane.starts) for lane in driven]
    places += [(x.name, tuple((i, float(k)) for i, _ in x.starts)) for k, x in enumerate(walked)]  # in order
    ends = {c.internal.name: (c.from_edge, c.to_edge) for c in layout.connections}
    table = _lane_table(places, ends, road.lanes)
    why = "not possible in SUMO, because the lanes lie in different edges"
    loss = MapLoss(kind="lane changes", why=why, elements=tuple(f"{a} to {b}" for a, b in lost))
    return WrittenNet(
        content=net_text(layout, lights, road.georeference, walks),
        drawing=extras_text(road),
        lanes=table,
        notes=tuple(notes),
        losses=(*road.losses, *([loss] if lost else ())),
    )


def _plan(
    road: Road, lanes: Mapping[int, Lane], clashes: Sequence[Conflict]
) -> tuple[NetLayout, Walks, list[tuple[int, int]]]:
    """Return the plan of the vehicle lanes, that of the footways, and the lane changes that are lost."""
    if all(lane.kind != "pedestrian" for lane in road.lanes.values()):
        topology, lost = cut_lanes(lanes, clashes)
        return plan_net(topology, road.regulations, clashes), Walks(), lost
    from scex_sumo.lanelet2sumo.plan.footways import crossed_zones, footways
    from scex_sumo.lanelet2sumo.plan.pedestrians import plan_walks

    footpaths = footways(road.lanes, lanes)
    topology, lost = cut_lanes(lanes, clashes, crossed_zones(footpaths))
    layout = plan_net(topology, road.regulations, clashes)
    return layout, plan_walks(footpaths, topology, layout), lost


def _side_lanes(road: Road) -> NetLayout:
    own = {i: lane for i, lane in road.lanes.items() if lane.kind in ("bus", "bicycle")}

    def joined(i: int, j: int) -> bool:
        near = math.dist(own[i].centreline[-1], own[j].centreline[0]) < JOINED_M
        return j != i and own[i].kind == own[j].kind and near

    lanes = {}
    for k, lane in own.items():
        after, before = (tuple(j for j in own if joined(k, j)), tuple(i for i in own if joined(i, k)))
        alone = replace(lane, left=None, right=None, conflicts=())
        lanes[k] = replace(alone, successors=after, predecessors=before)
    return plan_net(Topology(build_rows(lanes)[0], lanes, []), road.regulations, [])


def copy_net(road: Road) -> WrittenNet:
    """Copy what is allowed of a road's net; its own lights stay."""
    assert road.net is not None
    root = net_root(road.net)
    places = lane_places(root)
    table = _lane_table(places, read_ends(root), {lane for _, under in places for lane, _ in under})
    lit = [light.get("id", "") for light in root.iter("tlLogic") if light.find("condition") is not None]
    note = f"traffic lights with conditions: {listed(lit)}; in the futures their phases ignore the conditions"
    content = allowed_content(road.net)[0].decode()
    return WrittenNet(content=content, drawing=extras_text(road), lanes=table, notes=(note,) if lit else ())


def _lane_table(
    places: Iterable[tuple[str, Sequence[tuple[int, float]]]],
    ends: dict[str, tuple[str, str]],
    known: Container[int],
) -> LaneTable:
    """Build the lane table, with rows in driving order along lanelets and along internal lanes.

    ``places`` has each SUMO lane with (lanelet, arc length in m where it begins there), in driving order.
    Lanelets that are not ``known`` are left out.
    """
    along: dict[int, list[tuple[float, str]]] = {}
    within: dict[_TableRow, set[_TableRow]] = {}
    for sumo_lane, stretches in places:
        passed = set[_TableRow]()
        for lanelet, start in stretches:
            if lanelet in known:
                along.setdefault(lanelet, []).append((start, sumo_lane))
                within.setdefault((lanelet, sumo_lane), set()).update(passed)
                passed.add((lanelet, sumo_lane))
    before: dict[_TableRow, set[_TableRow]] = {key: set() for key in within}
    for lanelet, stations in along.items():
        rows = [(lanelet, sumo_lane) for _, sumo_lane in sorted(stations)]
        for earlier, next_row in pairwise(rows):
            before[next_row].add(earlier)
    return LaneTable(tuple(_sorted(within, before)), ends)


def _sorted(
    within: Mapping[_TableRow, set[_TableRow]], before: Mapping[_TableRow, set[_TableRow]]
) -> list[_TableRow]:
    """Sort keys behind those ``within`` and ``before`` name for them; in circles ``before`` may be broken."""
    waiting = {key: within[key] | before[key] for key in within}
    following: dict[_TableRow, list[_TableRow]] = {}
    for key, others in waiting.items():
        for other in others:
            following.setdefault(other, []).append(key)
    ready = sorted(key for key, others in waiting.items() if not others)
    result: list[_TableRow] = []
    while waiting:
        free = (row for row in waiting if waiting.keys().isdisjoint(within[row]))
        key = heapq.heappop(ready) if ready else min(free)
        if waiting.pop(key, None) is None:
            continue
        result.append(key)
        for follower in filter(waiting.__contains__, following.get(key, ())):
            waiting[follower].discard(key)
            if not waiting[follower]:
                heapq.heappush(ready, follower)
    return result
