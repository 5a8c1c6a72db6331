"""The bare loop: what SUMO alone takes for the vehicle-steps of a run, without models, metrics and files.

Tiles are loaded, vehicles added, and at every step each is moved to a given pose (moveToXY), SUMO steps, and
each pose is read back (getPosition, getAngle); poses are computed before. Three ways, slowest first:

- *plain*: libsumo as its documentation has it, keepRoute=2 and matchThreshold=5, a tile for each future;
- *in tiles*: with what this project found: a route of the edge with the fewest points, lanes looked for on
  that route only (keepRoute=3), libsumo's inner functions without their Python wrappers;
- *in one tile*: the same, all futures in one copy of the map, as a run without drivers of SUMO's does it.

*plain world* is `--world plain` alone: arrays in SUMO's place.

    python benchmarks/bare_loop.py [MAP.osm] [--futures 385] [--vehicles 11] [--steps 30]
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.maps import read_map
from scex_sumo.converters.net.convert import convert
from scex_sumo.extrapolation.job import VEHICLES_AT_ONCE
from scex_sumo.road import Road
from scex_sumo.scene import States
from scex_sumo.world.batch import to_sumo
from scex_sumo.world.plain import PlainWorld
from scex_sumo.world.session import VehicleCalls, load_sumo
from scex_sumo.world.tiles import TILE_SLOTS, TileTemplate, tile_id

DEFAULT_MAP = Path(__file__).parents[1] / "scex_sumo" / "scenarios" / "data" / "roundabout.osm"
OPTIONS = (
    *("--step-length", "0.1", "--no-step-log", "true", "--no-warnings", "true", "--xml-validation", "never"),
    *("--collision.action", "none", "--time-to-teleport", "-1", "--max-depart-delay", "-1"),
    *("--duration-log.disable", "true"),
)
LENGTH_M = 4.5
WAYS = ("plain", "in tiles", "in one tile")


@dataclass(frozen=True)
class Poses:
    """(C, T + 1, V) front bumpers and SUMO's angles, the start first."""

    x: FloatArray
    y: FloatArray
    angle: FloatArray


def poses_of(states: States, length: FloatArray) -> Poses:
    """Of (C, T + 1, V) states."""
    return Poses(*to_sumo(states, length))


def bare_loop(net: Path, poses: Poses, way: str = "in one tile") -> dict[str, float]:
    """Seconds of processor time by part.

    Args:
        net: SUMO net.
        poses: where every vehicle of every future is at every step.
        way: one of `WAYS`.
    """
    import libsumo as sumo

    plain, tiles = way == "plain", 1 if way == "in one tile" else TILE_SLOTS
    keep_route, threshold = (2, 5.0) if plain else (3, 20.0)
    futures, states, vehicles = poses.x.shape
    spent: Counter[str] = Counter()
    clock = time.process_time()

    def lap(part: str) -> None:
        nonlocal clock
        now = time.process_time()
        spent[part] += now - clock
        clock = now

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        template = TileTemplate(net)
        layout = template.layout()
        edge = next(iter(template._edges)) if plain else template.plainest_edge
        template.write(folder / "tiles.net.xml", range(tiles), layout)
        kind = '<vType id="car" vClass="ignoring" length="4.5" width="1.8" maxSpeed="200"/>'
        (folder / "types.add.xml").write_text(f"<additional>{kind}</additional>")
        files = ("-n", str(folder / "tiles.net.xml"), "-a", str(folder / "types.add.xml"))
        sumo.start(["sumo", *files, *OPTIONS])
        try:
            for tile in range(tiles):
                sumo.route.add(f"r{tile}", [tile_id(tile, edge)])
            sumo.simulation.saveState(str(folder / "empty.xml"))
            call = sumo.vehicle if plain else VehicleCalls.of(load_sumo())
            lap("load tiles")
            batch = (
                tiles if tiles > 1 else math.ceil(futures / math.ceil(futures * vehicles / VEHICLES_AT_ONCE))
            )
            for first in range(0, futures, batch):
                part = slice(first, first + batch)
                count = len(poses.x[part])
                if first:
                    sumo.simulation.loadState(str(folder / "empty.xml"))
                ids = [f"{c}_{v}" for c in range(count) for v in range(vehicles)]
                for number, key in enumerate(ids):
                    sumo.vehicle.add(key, f"r{number // vehicles % tiles}", "car")
                moved = np.array([layout.offset(c % tiles) for c in range(count)], dtype=float)[:, None]
                x, y = poses.x[part] + moved[..., :1], poses.y[part] + moved[..., 1:]
                told = [
                    (
                        x[:, t].ravel().tolist(),
                        y[:, t].ravel().tolist(),
                        poses.angle[part][:, t].ravel().tolist(),
                    )
                    for t in range(states)
                ]
                lap("add vehicles")
                for pose in told:
                    for key, to_x, to_y, degrees in zip(ids, *pose, strict=True):
                        call.moveToXY(key, "", -1, to_x, to_y, degrees, keep_route, threshold)
                    lap("move")
                    sumo.simulationStep()
                    lap("step")
                    for key in ids:
                        call.getPosition(key)
                        call.getAngle(key)
                    lap("read")
        finally:
            sumo.close()
    return dict(spent)


def straight_states(road: Road, futures: int, vehicles: int, steps: int) -> States:
    """(C, T + 1, V) vehicles that follow centrelines at 8 m/s, then straight on; all futures alike."""
    lanes = sorted(road.vehicle_lanes.values(), key=lambda lane: -len(lane.centreline))
    states = States.empty((futures, steps + 1, vehicles))
    for v in range(vehicles):
        line = lanes[v % len(lanes)].centreline
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        s = 0.8 * np.arange(steps + 1)
        index = np.clip(np.searchsorted(along, s, side="right") - 1, 0, len(line) - 2)
        dx, dy = (line[index + 1] - line[index]).T
        states.heading[:, :, v], states.speed[:, :, v] = np.arctan2(dy, dx), 8.0
        beyond = np.maximum(s - along[-1], 0.0)
        states.x[:, :, v] = np.interp(s, along, line[:, 0]) + beyond * np.cos(states.heading[0, :, v])
        states.y[:, :, v] = np.interp(s, along, line[:, 1]) + beyond * np.sin(states.heading[0, :, v])
    return states


def plain_world(states: States, length: FloatArray) -> float:
    """Seconds of processor time that `--world plain` takes for (C, T + 1, V) states."""
    futures, steps, vehicles = states.shape
    world, everybody = (
        PlainWorld(futures, vehicles, length=length),
        np.ones((futures, vehicles), dtype=bool),
    )
    begin = time.process_time()
    for step in range(1, steps):
        world.move(states[:, step], everybody)
        world.step()
        world.read()
    return time.process_time() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path, nargs="?", default=DEFAULT_MAP)
    parser.add_argument("--futures", type=int, default=385)
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--way", choices=WAYS, help="only this one")
    options = parser.parse_args()
    road = read_map(options.map, origin=None, own_corner=True)
    states = straight_states(road, options.futures, options.vehicles, options.steps)
    length = np.full(options.vehicles, LENGTH_M)
    poses = poses_of(states, length)
    total = options.futures * options.vehicles * options.steps
    with tempfile.TemporaryDirectory() as folder:
        net = convert(road, Path(folder) / "map.net.xml").path
        for way in [options.way] if options.way else WAYS:
            spent = bare_loop(net, poses, way)
            print(f"\n{way}")
            for name, seconds in [*spent.items(), ("all", sum(spent.values()))]:
                print(f"{name:14s} {seconds:7.3f} s {1e6 * seconds / total:7.2f} us per vehicle-step")
    if not options.way:
        seconds = min(plain_world(states, length) for _ in range(5))
        print(
            f"\nplain world    {seconds:7.3f} s, {total / seconds / 1e6:.1f} million vehicle-steps per second"
        )


if __name__ == "__main__":
    main()
