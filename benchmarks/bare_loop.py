"""What it costs to advance vehicles through SUMO: microseconds per vehicle-step, by part.

The job of a run without models and metrics: 385 children of 11 vehicles, 30 steps, in batches of 64 tiles;
everybody drives along the lanes of the map.

    python benchmarks/bare_loop.py [MAP.osm] [--children 385] [--vehicles 11] [--steps 30] [--driver EIDM]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scex_sumo.converters.lanelet import read_road
from scex_sumo.converters.sumo_net import SumoNet, convert
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene, States
from scex_sumo.world import TILE_SLOTS, SumoDriven, World

DEFAULT_MAP = Path(__file__).parents[1] / "scex_sumo" / "scenarios" / "data" / "roundabout.osm"


def positions(road: Road, vehicles: int, steps: int) -> States:
    """(V, T) vehicles that follow centrelines at 8 m/s, straight on where one ends."""
    lanes = sorted(road.vehicle_lanes.values(), key=lambda lane: -len(lane.centreline))
    states = States.empty((vehicles, steps))
    for v in range(vehicles):
        line = lanes[v % len(lanes)].centreline
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        s = 0.8 * np.arange(steps)
        states.x[v] = np.interp(s, along, line[:, 0])
        states.y[v] = np.interp(s, along, line[:, 1])
        index = np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(line) - 2)
        dx, dy = (line[index + 1] - line[index]).T
        states.heading[v], states.speed[v] = np.arctan2(dy, dx), 8.0
        beyond = np.maximum(s - along[-1], 0.0)
        states.x[v] += beyond * np.cos(states.heading[v])
        states.y[v] += beyond * np.sin(states.heading[v])
    return states


def seed_of(states: States) -> SeedScene:
    """A seed scene in which every vehicle has stood still."""
    count = states.shape[0]

    def past(values: np.ndarray) -> np.ndarray:
        return np.repeat(values[:, :1], 11, axis=1)

    history = States(
        x=past(states.x), y=past(states.y), heading=past(states.heading), speed=past(states.speed)
    )
    return SeedScene(
        name="benchmark",
        location="benchmark",
        time_s=0.0,
        track_ids=np.arange(count),
        types=("car",) * count,
        length=np.full(count, 4.5),
        width=np.full(count, 1.8),
        history=history,
        recorded_steps=np.full(count, 10),
    )


def route_of(net: SumoNet, road: Road, vehicle: int) -> tuple[str, ...]:
    """The lane that the vehicle is on and two successors, as SUMO's edges."""
    lane = sorted(road.vehicle_lanes.values(), key=lambda lane: -len(lane.centreline))[
        vehicle % len(road.vehicle_lanes)
    ]
    lanes = [lane.lane_id]
    while len(lanes) < 3 and road.lanes[lanes[-1]].successors:
        lanes.append(road.lanes[lanes[-1]].successors[0])
    return tuple(net.lanes.edges(lanes))


def repeated(states: States, count: int) -> States:
    """(C, ...) copies."""
    return States.stack([states] * count, axis=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path, nargs="?", default=DEFAULT_MAP)
    parser.add_argument("--children", type=int, default=385)
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--driver", help="SUMO's name of a car-following model that drives the first vehicle")
    options = parser.parse_args()
    road = read_road(options.map)
    spent: Counter[str] = Counter()

    def timed(name: str, call: Callable[..., States | None], *arguments: object) -> None:
        begin = time.perf_counter()
        call(*arguments)
        spent[name] += time.perf_counter() - begin

    with tempfile.TemporaryDirectory() as folder:
        net = convert(road, Path(folder) / "map.net.xml")
        plan = positions(road, options.vehicles, options.steps + 1)
        driver = options.driver
        mask = np.ones((TILE_SLOTS, options.vehicles), dtype=bool)
        mask[:, 0] = not driver
        with World(net, seed_of(plan), slots=range(min(TILE_SLOTS, options.children))) as world:
            for first in range(0, options.children, TILE_SLOTS):
                count = min(TILE_SLOTS, options.children - first)
                driven = [
                    SumoDriven(child=c, vehicle=0, model=driver, parameters={}, edges=route_of(net, road, 0))
                    for c in range(count if driver else 0)
                ]
                name = "first begin (imports libsumo, loads the tiles)" if first == 0 else "begin"
                timed(name, world.begin, repeated(plan[:, 0], count), np.arange(count), driven)
                for step in range(1, options.steps + 1):
                    timed("move", world.move, repeated(plan[:, step], count), mask[:count])
                    timed("step", world.step)
                    timed("read", world.read)
    total = options.children * options.vehicles * options.steps
    for name, seconds in spent.items():
        print(f"{name:50s} {seconds:7.3f} s {1e6 * seconds / total:7.2f} us per vehicle-step")
    print(f"{'all':50s} {spent.total():7.3f} s {1e6 * spent.total() / total:7.2f} us per vehicle-step")


if __name__ == "__main__":
    main()
