"""Conversion of a road to a SUMO net: the public face of the net writer.

The net file is written directly, not by netconvert, so that every shape is the map's own. What holds ids
and coordinates in it, for whoever copies or moves nets as text:

- ids: ``edge`` id, from, to; ``lane`` id; ``junction`` id, incLanes, intLanes (lists); ``connection`` from,
  to, via, tl, and from, to of a ``conflict`` in it; ``tlLogic`` id. Internal ones begin with a colon:
  ``:NODE_3_0``.
- coordinates: ``edge`` and ``lane`` shape, ``junction`` x, y, shape, ``location`` boundaries. Everything is
  in the map's own coordinates; less netOffset they are those of the projection, where that is known.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from scex_sumo.converters.net.elements import NetLayout
from scex_sumo.converters.net.extras import extras_text
from scex_sumo.converters.net.lane_table import LaneTable, lane_table, read_ends
from scex_sumo.converters.net.lights import Programme, fixed_programmes
from scex_sumo.converters.net.pieces.borders import add_approaches, add_entries
from scex_sumo.converters.net.pieces.rows import build_rows
from scex_sumo.converters.net.pieces.topology import Topology, cut_lanes
from scex_sumo.converters.net.plan import plan_net
from scex_sumo.converters.net.signals import recorded_programme
from scex_sumo.converters.net.sumo_net import SumoNet, net_file
from scex_sumo.converters.net.text import net_text
from scex_sumo.converters.net.walking.footways import crossed_zones, footways
from scex_sumo.converters.net.walking.lit import with_crossings
from scex_sumo.converters.net.walking.walks import plan_walks
from scex_sumo.converters.sumo.net import lane_places, unpacked
from scex_sumo.errors import MapError
from scex_sumo.files import write_atomic
from scex_sumo.geometry.polylines import length_of
from scex_sumo.road import Loss, Road
from scex_sumo.roads.conflicts import conflicts

__all__ = ["LaneTable", "SumoNet", "convert"]

SHORTEST_M = 0.01
JOINED_M = 0.3  # how far apart bus or bicycle lanes may end and begin and still follow one another


def convert(road: Road, net_path: Path, *, signals: Path | None = None) -> SumoNet:
    """Write a road as a SUMO net, with its lane table NET.lanes.csv and drawing NET.add.xml beside it.

    Args:
        road: the map.
        net_path: where to write; usually ends in ``.net.xml``.
        signals: recorded signal phases (SPaT) as CSV; the intersection's KML is looked for beside it.

    Raises:
        MapError: the road has no vehicle lanes, or some without length; the signals cannot be used.
    """
    if road.net is not None:
        return _as_it_is(road, road.net, net_path)
    lanes = road.vehicle_lanes
    if not lanes:
        raise MapError(f"{road.name}: no lanelet that cars may drive on; nothing to convert")
    points = sorted(i for i, lane in lanes.items() if length_of(lane.centreline) < SHORTEST_M)
    if points:
        raise MapError(f"{road.name}: lanelets without length: {', '.join(map(str, points[:5]))}; drop them")
    lanes = add_entries(lanes, road.lanes)
    found = conflicts(lanes, border_forks=True)
    if (approached := add_approaches(lanes, found, road.lanes)).keys() != lanes.keys():
        lanes, found = approached, conflicts(approached, border_forks=True)
    ways = footways(road.lanes, lanes)
    topology, lost = cut_lanes(lanes, found, crossed_zones(ways))
    layout = plan_net(topology, road.regulations, found)
    recorded, notes = (None, []) if signals is None else recorded_programme(layout, road.origin, signals)
    fixed = fixed_programmes(layout, lanes, road.regulations, found)
    walks = plan_walks(ways, topology, layout)
    lights, unlit = with_crossings(_together(recorded, fixed), recorded, walks, layout)
    if unlit:
        notes.append(f"crosswalks that the recorded lights never leave free: {', '.join(map(str, unlit))}")
    layout = layout.beside(_side_lanes(road))
    net_path.write_text(net_text(layout, lights, road.georeference, walks), encoding="utf-8")
    table = lane_table([*layout.places(), *walks.places()], layout.ends(), road.lanes)
    table.write(net_file(net_path, ".lanes.csv"))
    extras = net_file(net_path, ".add.xml")
    extras.write_text(extras_text(road), encoding="utf-8")
    changes = tuple(f"{a} to {b}" for a, b in lost)
    losses = (
        [Loss(kind="lane changes", why="without a place in a SUMO edge", elements=changes)] if lost else []
    )
    return SumoNet(
        path=net_path, extras=extras, lanes=table, notes=tuple(notes), losses=(*road.losses, *losses)
    )


def _as_it_is(road: Road, source: Path, net_path: Path) -> SumoNet:
    """The net that a road was read from, its lane table and drawing beside it."""
    table, extras = _copy_net(source, net_path), net_file(net_path, ".add.xml")
    table.write(net_file(net_path, ".lanes.csv"))
    extras.write_text(extras_text(road), encoding="utf-8")
    return SumoNet(path=net_path, extras=extras, lanes=table)


def _side_lanes(road: Road) -> NetLayout:
    """Lanes for buses and bicycles alone; people walk beside them."""
    own = {i: lane for i, lane in road.lanes.items() if lane.kind in ("bus", "bicycle")}
    ends = {i: (lane.centreline[0], lane.centreline[-1]) for i, lane in own.items()}
    following = {
        i: tuple(
            j
            for j in own
            if j != i and own[i].kind == own[j].kind and math.dist(ends[i][1], ends[j][0]) < JOINED_M
        )
        for i in own
    }
    lanes = {
        i: replace(
            lane,
            successors=following[i],
            predecessors=tuple(j for j in own if i in following[j]),
            left=None,
            right=None,
            conflicts=(),
        )
        for i, lane in own.items()
    }
    rows, _ = build_rows(lanes)
    return plan_net(Topology(rows, lanes, []), road.regulations, [])


def _together(recorded: Programme | None, fixed: list[Programme]) -> list[Programme]:
    """The recorded lights, and the fixed programmes of the links that these leave out."""
    if recorded is None:
        return fixed
    taken = {c.internal.name for c in recorded.connections}
    return [recorded, *(p for p in fixed if taken.isdisjoint(c.internal.name for c in p.connections))]


def _copy_net(source: Path, net_path: Path) -> LaneTable:
    """Copy a net, unpacked; the table of its lanes, which are numbered as those of its road."""
    write_atomic(net_path, unpacked(source))
    places = lane_places(source)
    return lane_table(places, read_ends(net_path), {lane for _, under in places for lane, _ in under})
