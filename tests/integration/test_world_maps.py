"""Real maps: vehicles along every lane and beyond its end, moved and driven by SUMO; nobody is lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Lane
from scex_sumo.scene import States
from scex_sumo.world.base import BatchStart, SumoDriven, WorldRequest
from scex_sumo.world.sumo import SumoWorld
from tests.seeds import seed_of, standing

MAPS = (
    "interaction/maps/DR_DEU_Merging_MT.osm",
    "interaction/maps/DR_DEU_Roundabout_OF.osm",
    "taf_bw/maps/k733_2020-09-15.osm",
    "taf_bw/maps/k729_2022-03-16.osm",
)
SPEED = 8.0


def along(lane: Lane, distance: float) -> tuple[float, float, float]:
    """Place and heading on a centreline, straight on beyond its end."""
    line = lane.centreline
    lengths = np.hypot(*np.diff(line, axis=0).T)
    k = min(int(np.searchsorted(np.cumsum(lengths), distance)), len(lengths) - 1)
    heading = float(np.arctan2(*(line[k + 1] - line[k])[::-1]))
    rest = distance - lengths[:k].sum()
    return line[k, 0] + rest * np.cos(heading), line[k, 1] + rest * np.sin(heading), heading


def states(lanes: list[Lane], distance: float) -> States:
    """(V,) one vehicle on each lane."""
    x, y, heading = np.array([along(lane, distance) for lane in lanes]).T
    return States(x=x, y=y, heading=heading, speed=np.full(len(lanes), SPEED))


@pytest.mark.parametrize("map_path", MAPS)
def test_vehicles_on_all_lanes_are_where_they_were_planned_and_none_is_lost(
    data: Path, tmp_path: Path, map_path: str
) -> None:
    road = read_road(data / map_path)
    net = convert(road, tmp_path / "map.net.xml")
    lanes = [road.vehicle_lanes[key] for key in sorted(road.vehicle_lanes)]
    start, count = states(lanes, 0.3), len(lanes)
    seed = seed_of(standing(start), track_ids=np.arange(count))
    # In the second future SUMO drives every third vehicle, down its lane and on.
    moved = np.ones((2, count), dtype=bool)
    moved[1, ::3] = False
    drivers = []
    for v in range(0, count, 3):
        ahead = [lanes[v].lane_id, *lanes[v].successors[:1]]
        edges = tuple(net.lanes.edges(ahead))
        drivers.append(SumoDriven(future=1, vehicle=v, model="EIDM", parameters={}, edges=edges))
    with SumoWorld(WorldRequest(net=net, scene=seed, slots=[0, 63])) as world:
        world.begin(BatchStart(slots=np.array([0, 63]), driven=drivers), start.repeat(2))
        before = world.read()
        assert max(np.abs(before.x - start.x).max(), np.abs(before.y - start.y).max()) < 1e-9
        for step in range(1, 31):
            plan = states(lanes, 0.3 + 0.1 * SPEED * step).repeat(2)
            world.move(plan, moved)
            world.step()
            read = world.read()
            assert max(np.abs(read.x - plan.x)[moved].max(), np.abs(read.y - plan.y)[moved].max()) < 1e-9
            assert np.abs(read.speed - SPEED)[moved].max() < 1e-9
            way = np.hypot(read.x - before.x, read.y - before.y)[~moved]
            assert way.max() < 4.0  # 0.1 s at 20 m/s, and the turn of a 4.5 m car to its lane
            before = read
