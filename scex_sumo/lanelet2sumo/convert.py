"""Conversion of a road to a SUMO net.

The net is written directly, not by netconvert, to keep the map's shapes and coordinates.
"""

from __future__ import annotations

import hashlib
import json
import math
import pickle
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from scex_sumo.base.cache import cached_bytes
from scex_sumo.base.errors import MapError, listed
from scex_sumo.base.files import write_atomic
from scex_sumo.base.version import __version__, version_of
from scex_sumo.converters.net.allowed import allowed_content
from scex_sumo.converters.net.lanelets import lane_places
from scex_sumo.converters.net.reader import net_root
from scex_sumo.converters.net.sumo_net import LaneTable, SumoNet, lane_table, net_file, read_ends
from scex_sumo.converters.registries import signal_format
from scex_sumo.geometry.polylines import length_of
from scex_sumo.lanelet2sumo.plan.footways import crossed_zones, footways
from scex_sumo.lanelet2sumo.plan.layout import NetLayout, plan_net
from scex_sumo.lanelet2sumo.plan.lights import Programme, fixed_programmes, with_crossings
from scex_sumo.lanelet2sumo.plan.pedestrians import plan_walks
from scex_sumo.lanelet2sumo.topology.borders import add_approaches, add_entries
from scex_sumo.lanelet2sumo.topology.graph import Topology, build_rows, cut_lanes
from scex_sumo.lanelet2sumo.writing.drawing import extras_text
from scex_sumo.lanelet2sumo.writing.text import net_text
from scex_sumo.road import MapLoss, Road
from scex_sumo.roads.conflicts import conflicts

__all__ = ["LaneTable", "SumoNet", "convert"]

SHORTEST_M = 0.01
JOINED_M = 0.3  # between consecutive bus or bicycle lanes


def convert(road: Road, net_path: str | Path, *, signals: str | Path | None = None) -> SumoNet:
    """Write a road as a SUMO net, with its lane table NET.lanes.csv and its drawing NET.add.xml beside it.

    Args:
        signals: CSV of recorded signal phases (SPaT); the intersection's KML must lie beside it.

    Raises:
        MapError: the road has no vehicle lanes, or some without length; the signals cannot be used.

    Example:
        >>> net = scex.convert(scene.road, Path("roundabout.net.xml"))
        >>> net.path.is_file()
        True
    """
    net_path = Path(net_path)
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
    recorded, notes = None, list[str]()
    if signals is not None:
        signals = Path(signals)
        recorded, notes = signal_format(signals).read(layout, road.origin, signals)
    fixed = fixed_programmes(layout, lanes, road.regulations, found)
    walks = plan_walks(ways, topology, layout)
    lights, unlit = with_crossings(_with_fixed_programmes(recorded, fixed), recorded, walks, layout)
    if unlit:
        notes.append(
            f"crosswalks without green for people, because the lights never stop the cars: {listed(unlit)}"
        )
    layout = layout.beside(_side_lanes(road))
    net_path.write_text(net_text(layout, lights, road.georeference, walks), encoding="utf-8")
    table = lane_table([*layout.places(), *walks.places()], layout.ends(), road.lanes)
    why = "not possible in SUMO, because the lanes lie in different edges"
    loss = MapLoss(kind="lane changes", why=why, elements=tuple(f"{a} to {b}" for a, b in lost))
    return _with_files(road, net_path, table, notes, (*road.losses, *([loss] if lost else ())))


def _as_it_is(road: Road, source: Path, net_path: Path) -> SumoNet:
    write_atomic(net_path, allowed_content(source)[0])
    root = net_root(source)
    places = lane_places(root)
    table = lane_table(places, read_ends(root), {lane for _, under in places for lane, _ in under})
    lit = [light.get("id", "") for light in root.iter("tlLogic") if light.find("condition") is not None]
    note = f"traffic lights with conditions: {listed(lit)}; in the futures their phases ignore the conditions"
    return _with_files(road, net_path, table, [note] if lit else [], ())


def _with_files(
    road: Road, net_path: Path, table: LaneTable, notes: Sequence[str], losses: tuple[MapLoss, ...]
) -> SumoNet:
    extras = net_file(net_path, ".add.xml")
    table.write(net_file(net_path, ".lanes.csv"))
    extras.write_text(extras_text(road), encoding="utf-8")
    return SumoNet(path=net_path, extras=extras, lanes=table, notes=tuple(notes), losses=losses)


def _side_lanes(road: Road) -> NetLayout:
    own = {i: lane for i, lane in road.lanes.items() if lane.kind in ("bus", "bicycle")}
    ends = {i: (lane.centreline[0], lane.centreline[-1]) for i, lane in own.items()}
    joined = [
        (i, j)
        for i in own
        for j in own
        if j != i and own[i].kind == own[j].kind and math.dist(ends[i][1], ends[j][0]) < JOINED_M
    ]
    lanes = {
        k: replace(
            lane,
            successors=tuple(j for i, j in joined if i == k),
            predecessors=tuple(i for i, j in joined if j == k),
            left=None,
            right=None,
            conflicts=(),
        )
        for k, lane in own.items()
    }
    return plan_net(Topology(build_rows(lanes)[0], lanes, []), road.regulations, [])


def _with_fixed_programmes(recorded: Programme | None, fixed: list[Programme]) -> list[Programme]:
    if recorded is None:
        return fixed
    taken = {c.internal.name for c in recorded.connections}
    return [recorded, *(p for p in fixed if taken.isdisjoint(c.internal.name for c in p.connections))]


_ENDINGS = (".net.xml", ".lanes.csv", ".add.xml")


def converted(road: Road, net_path: Path, *, keep: bool = True) -> SumoNet:
    """Convert a road as `convert` does, or take the net from the cache.

    ``keep=False`` neither reads nor writes the cache.
    """
    made: list[SumoNet] = []

    def make() -> bytes:
        made.append(convert(road, net_path))
        return _packed(made[0]) if keep else b""

    if keep:
        key = hashlib.sha256(pickle.dumps((__version__, version_of("shapely"), road)))
        packed = cached_bytes("nets", key.digest(), make)
    else:
        packed = make()
    if not made:
        try:
            return _unpacked(packed, net_path)
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):  # not written by us
            make()
    return made[0]


def _file(net_path: Path, ending: str) -> Path:
    return net_path if ending == ".net.xml" else net_file(net_path, ending)


def _packed(net: SumoNet) -> bytes:
    content = {
        "files": {ending: _file(net.path, ending).read_text(encoding="utf-8") for ending in _ENDINGS},
        "rows": net.lanes.rows,
        "ends": net.lanes.ends,
        "notes": net.notes,
        "losses": [asdict(loss) for loss in net.losses],
    }
    return json.dumps(content).encode()


def _unpacked(packed: bytes, net_path: Path) -> SumoNet:
    content = json.loads(packed)
    ends = {str(lane): (str(before), str(after)) for lane, (before, after) in content["ends"].items()}
    net = SumoNet(
        path=net_path,
        extras=_file(net_path, ".add.xml"),
        lanes=LaneTable([(int(lanelet), str(lane)) for lanelet, lane in content["rows"]], ends),
        notes=tuple(map(str, content["notes"])),
        losses=tuple(MapLoss(**{**loss, "elements": tuple(loss["elements"])}) for loss in content["losses"]),
    )
    for ending in _ENDINGS:
        _file(net_path, ending).write_text(content["files"][ending], encoding="utf-8")
    return net
