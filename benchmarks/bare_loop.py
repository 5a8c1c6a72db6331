"""The bare loop: what SUMO alone takes for the vehicle-steps of a run, without models, metrics and files.

A tile of the net is loaded for each future, vehicles are added, and at every step each is moved to a given
pose (moveToXY with keepRoute=2 and matchThreshold=5, as libsumo documents it), SUMO steps, and each pose is
read back. The poses are computed before.

    python benchmarks/bare_loop.py [MAP.osm] [--futures 385] [--vehicles 11] [--steps 30]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

import libsumo as sumo
import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.maps import read_map
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from scex_sumo.scene import States
from scex_sumo.world.batch import to_sumo
from scex_sumo.world.tiles import TILE_SLOTS, TileTemplate, tile_id

DEFAULT_MAP = Path(__file__).parents[1] / "scex_sumo" / "scenarios" / "data" / "roundabout.osm"
OPTIONS = (
    *("--step-length", "0.1", "--no-step-log", "true", "--no-warnings", "true", "--xml-validation", "never"),
    *("--collision.action", "none", "--time-to-teleport", "-1", "--max-depart-delay", "-1"),
    *("--duration-log.disable", "true"),
)
LENGTH_M = 4.5


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


def bare_loop(net: Path, x: FloatArray, y: FloatArray, angle: FloatArray) -> dict[str, float]:
    """Seconds of processor time by part.

    Args:
        net: SUMO net.
        x: (C, T + 1, V) front bumpers, m; ``y`` and SUMO's ``angle`` likewise.
    """
    futures, states, vehicles = x.shape
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
        layout, edge = template.layout(), next(iter(template._edges))
        template.write(folder / "tiles.net.xml", range(TILE_SLOTS), layout)
        kind = '<vType id="car" vClass="ignoring" length="4.5" width="1.8" maxSpeed="200"/>'
        (folder / "types.add.xml").write_text(f"<additional>{kind}</additional>")
        files = ("-n", str(folder / "tiles.net.xml"), "-a", str(folder / "types.add.xml"))
        sumo.start(["sumo", *files, *OPTIONS])
        try:
            for tile in range(TILE_SLOTS):
                sumo.route.add(f"r{tile}", [tile_id(tile, edge)])
            sumo.simulation.saveState(str(folder / "empty.xml"))
            lap("load tiles")
            for first in range(0, futures, TILE_SLOTS):
                part = slice(first, first + TILE_SLOTS)
                count = len(x[part])
                if first:
                    sumo.simulation.loadState(str(folder / "empty.xml"))
                ids = [f"{c}_{v}" for c in range(count) for v in range(vehicles)]
                for number, key in enumerate(ids):
                    sumo.vehicle.add(key, f"r{number // vehicles}", "car")
                moved = np.array([layout.offset(c) for c in range(count)], dtype=float)[:, None, None]
                arrays = (x[part] + moved[..., 0], y[part] + moved[..., 1], angle[part])
                poses = [[values[:, t].ravel().tolist() for values in arrays] for t in range(states)]
                lap("add vehicles")
                for pose in poses:
                    for key, to_x, to_y, degrees in zip(ids, *pose, strict=True):
                        sumo.vehicle.moveToXY(key, "", -1, to_x, to_y, degrees, 2, 5.0)
                    lap("move")
                    sumo.simulationStep()
                    lap("step")
                    for key in ids:
                        sumo.vehicle.getPosition(key)
                        sumo.vehicle.getAngle(key)
                    lap("read")
        finally:
            sumo.close()
    return dict(spent)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path, nargs="?", default=DEFAULT_MAP)
    parser.add_argument("--futures", type=int, default=385)
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--steps", type=int, default=30)
    options = parser.parse_args()
    road = read_map(options.map, origin=None, own_corner=True)
    states = straight_states(road, options.futures, options.vehicles, options.steps)
    total = options.futures * options.vehicles * options.steps
    with tempfile.TemporaryDirectory() as folder:
        net = convert(road, Path(folder) / "map.net.xml").path
        spent = bare_loop(net, *to_sumo(states, np.full(options.vehicles, LENGTH_M)))
    for name, seconds in [*spent.items(), ("all", sum(spent.values()))]:
        print(f"{name:14s} {seconds:7.3f} s {1e6 * seconds / total:7.2f} us per vehicle-step")


if __name__ == "__main__":
    main()
