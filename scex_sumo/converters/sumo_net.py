"""A road becomes a SUMO net: the public face of the sumo_* modules.

The net file is written directly, not by netconvert, so that every shape is the map's own. What holds ids
and coordinates in it, for whoever copies or moves nets as text:

- ids: ``edge`` id, from, to; ``lane`` id; ``junction`` id, incLanes, intLanes (lists); ``connection`` from,
  to, via, tl; ``tlLogic`` id. Internal ones begin with a colon: ``:NODE_3_0``.
- coordinates: ``lane`` shape, ``junction`` x, y, shape, ``location`` boundaries. Everything is in the map's
  own coordinates; netOffset is zero.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from scex_sumo.converters.sumo_conflicts import conflicts
from scex_sumo.converters.sumo_gaps import fill_gaps, open_knots
from scex_sumo.converters.sumo_lanes import LaneTable
from scex_sumo.converters.sumo_plan import NetPlan
from scex_sumo.converters.sumo_rows import build_rows, lay_zones
from scex_sumo.converters.sumo_topology import Topology
from scex_sumo.converters.sumo_write import net_text
from scex_sumo.errors import MapError
from scex_sumo.road import Road

__all__ = ["LaneTable", "SumoNet", "convert"]


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoNet:
    """A converted net.

    Attributes:
        path: NET.net.xml.
        extras: NET.add.xml with markings, stop lines, crosswalks and areas for sumo-gui, or None.
        lanes: which SUMO lanes a lanelet became.
        notes: what could not be carried over, one short sentence each, naming ids.
    """

    path: Path
    extras: Path | None
    lanes: LaneTable
    notes: tuple[str, ...] = ()


def convert(road: Road, net_path: Path, *, signals: Path | None = None) -> SumoNet:
    """Write a road as a SUMO net, with its lane table NET.lanes.csv and drawing NET.add.xml beside it.

    Args:
        road: the map.
        net_path: where to write; usually ends in ``.net.xml``.
        signals: recorded signal phases (SPaT) as CSV; the intersection's KML is looked for beside it.

    Raises:
        MapError: the road has no vehicle lanes.
    """
    lanes = road.vehicle_lanes
    if not lanes:
        raise MapError(f"{road.name}: no lanelet that cars may drive on; nothing to convert")
    found = conflicts(road)
    rows, lost = build_rows(lanes)
    lay_zones(rows, lanes, found)
    open_knots(rows, lanes)
    fill_gaps(rows, lanes)
    plan = NetPlan(road, Topology(rows, lanes, found), found)
    net_path.write_text(net_text(plan), encoding="utf-8")
    table = _table(plan)
    table.write(beside(net_path, ".lanes.csv"))
    notes = tuple(f"the lane change from lanelet {a} to {b} has no place in a SUMO edge" for a, b in lost)
    return SumoNet(path=net_path, extras=None, lanes=table, notes=notes)


def beside(net_path: Path, suffix: str) -> Path:
    """The file that belongs to NET.net.xml with another ending: NET + suffix."""
    return net_path.with_name(net_path.name.removesuffix(".xml").removesuffix(".net") + suffix)


def _table(plan: NetPlan) -> LaneTable:
    """Rows in driving order, both along a lanelet and along an internal lane over several lanelets."""
    along: dict[int, list[tuple[float, str]]] = {}
    after: dict[tuple[int, str], set[tuple[int, str]]] = {}
    for lane, places in plan.places():
        for lanelet, start in places:
            along.setdefault(lanelet, []).append((start, lane))
        keys = [(lanelet, lane) for lanelet, _ in places]
        for k, key in enumerate(keys):
            after.setdefault(key, set()).update(keys[:k])
    for lanelet in sorted(along):
        keys = [(lanelet, lane) for _, lane in sorted(along[lanelet])]
        for before, key in pairwise(keys):
            after[key].add(before)
    ends = {
        c.internal.name: (c.from_edge, c.to_edge) for node in plan.nodes.values() for c in node.connections
    }
    return LaneTable(_sorted(after), ends)


def _sorted(after: dict[tuple[int, str], set[tuple[int, str]]]) -> list[tuple[int, str]]:
    """Topological order, smallest key first; a ring within one junction has no order and is broken there."""
    waiting = {key: set(before) for key, before in after.items()}
    following: dict[tuple[int, str], list[tuple[int, str]]] = {}
    for key, befores in after.items():
        for before in befores:
            following.setdefault(before, []).append(key)
    ready = [key for key, before in waiting.items() if not before]
    heapq.heapify(ready)
    result = []
    while waiting:
        key = heapq.heappop(ready) if ready else min(waiting)
        if key not in waiting:
            continue
        del waiting[key]
        result.append(key)
        for later in following.get(key, ()):
            if later in waiting:
                waiting[later].discard(key)
                if not waiting[later]:
                    heapq.heappush(ready, later)
    return result
