"""How time and memory grow with futures, vehicles, steps and the size of the map.

Every point is a process of its own: processor time of a whole run (without reading the map), also for each
vehicle-step, and the peak of the process's memory above that before the run. Vehicles and maps grow on copies
of a map side by side, whose scenes are those of the map.

    python benchmarks/scaling.py [MAP.osm] [--full] [--recording FILE]

``--recording`` adds the whole command, 385 futures and their reference, on a crowded recorded moment.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from bare_loop import DEFAULT_MAP
from scipy.special import stdtrit

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import Lane, Road
from scex_sumo.scene import SeedScene, States

UNITS = {"cpu": "s", "each": "us", "memory": "MB", "size": "MB"}
DIGITS = {"cpu": 3, "each": 2, "memory": 1, "size": 1}
PITCH_M = 1500.0
PER_COPY = 10  # vehicles in each copy of the map


def copied_road(road: Road, copies: int) -> Road:
    """Copies of a map side by side; lanes of copy k have ids that end in k."""

    def lane_id(lane: int, copy: int) -> int:
        return lane * 1000 + copy

    def ids(lanes: tuple[int, ...], copy: int) -> tuple[int, ...]:
        return tuple(lane_id(lane, copy) for lane in lanes)

    def one(lane: int | None, copy: int) -> int | None:
        return None if lane is None else lane_id(lane, copy)

    def moved(points: FloatArray, copy: int) -> FloatArray:
        return points + np.array([PITCH_M * copy, 0.0])

    def copied(lane: Lane, copy: int) -> Lane:
        return dataclasses.replace(
            lane,
            lane_id=lane_id(lane.lane_id, copy),
            centreline=moved(lane.centreline, copy),
            left_bound=moved(lane.left_bound, copy),
            right_bound=moved(lane.right_bound, copy),
            successors=ids(lane.successors, copy),
            predecessors=ids(lane.predecessors, copy),
            left=one(lane.left, copy),
            right=one(lane.right, copy),
            adjacent_left=one(lane.adjacent_left, copy),
            adjacent_right=one(lane.adjacent_right, copy),
            conflicts=ids(lane.conflicts, copy),
            reverse_of=one(lane.reverse_of, copy),
        )

    lanes = [copied(lane, copy) for copy in range(copies) for lane in road.lanes.values()]
    rules = [
        dataclasses.replace(
            rule,
            element_id=rule.element_id * 1000 + copy,
            lanes=ids(rule.lanes, copy),
            yielding=ids(rule.yielding, copy),
            priority=ids(rule.priority, copy),
            stop_lines=tuple(moved(line, copy) for line in rule.stop_lines),
            lights=ids(rule.lights, copy),
        )
        for copy in range(copies)
        for rule in road.regulations
    ]
    by_id = {lane.lane_id: lane for lane in lanes}
    return Road(name=f"{road.name}_{copies}", lanes=by_id, regulations=tuple(rules), origin=road.origin)


def copied_scene(scene: SeedScene, road: Road, vehicles: int) -> SeedScene:
    """The scene's first vehicles in one copy of its map after the other, as many as are wanted."""
    copy, index = np.divmod(np.arange(vehicles), min(PER_COPY, scene.vehicles))
    history = scene.history[index]
    moved = dataclasses.replace(history, x=history.x + PITCH_M * copy[:, None])
    return SeedScene(
        name=f"{scene.name}_{vehicles}",
        location=scene.location,
        time_s=scene.time_s,
        track_ids=np.arange(vehicles),
        types=tuple(scene.types[i] for i in index),
        length=scene.length[index],
        width=scene.width[index],
        history=States(x=moved.x, y=moved.y, heading=moved.heading, speed=moved.speed),
        recorded_steps=scene.recorded_steps[index],
        road=road,
    )


def measure(map_path: Path, vehicles: int, futures: int, steps: int, copies: int) -> dict[str, float]:
    """One run; for a process of its own."""
    import scex_sumo
    from scex_sumo.scenarios.populated import synthetic_seed
    from scex_sumo.world.sumo import load_sumo

    load_sumo()
    small = synthetic_seed(map_path, vehicles=PER_COPY)
    assert small.road is not None
    scene = copied_scene(small, copied_road(small.road, copies), vehicles)
    scex_sumo.extrapolate(small, futures=2, steps=5, reference=None, report=False)  # imports
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        scex_sumo.extrapolate(
            scene, futures=futures, steps=steps, reference=None, report=False, out=Path(folder) / "out"
        )
        spent = time.process_time() - begin
        size = sum(f.stat().st_size for f in (Path(folder) / "out").rglob("*") if f.is_file())
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "cpu": spent,
        "each": 1e6 * spent / (vehicles * futures * steps),
        "memory": (after - before) / 1024,
        "size": size / 1e6,
    }


def recorded(recording: Path) -> None:
    """Print what the whole command takes on a recorded moment, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [sys.executable, "-m", "scex_sumo", "run", str(recording), "-o", str(out)]
        begin = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - begin
        if process.returncode:
            raise SystemExit(f"{' '.join(command)}: exit {process.returncode}")
        info = json.loads((out / "run.json").read_text())
        size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    print(
        f"\n{recording.name}: {info['seed_scene']['vehicles']} vehicles x {info['futures']} futures, whole "
        f"command: {used.ru_utime + used.ru_stime:.1f} s of processor time, {wall:.1f} s, peak memory "
        f"{used.ru_maxrss / 1024:.0f} MB, folder {size / 1e6:.0f} MB"
    )


def series(name: str, map_path: Path, points: list[int], fixed: dict[str, int]) -> None:
    """Measure some points, print a table with the exponent of each quantity over its last points."""
    print(f"\n{name} ({', '.join(f'{value} {key}' for key, value in fixed.items() if key != name)})")
    columns = ("cpu", "each", "memory", "size")
    print(f"{name:>10s}" + "".join(f"{c:>12s}" for c in columns))
    found = []
    for point in points:
        given = {**fixed, name: point}
        if name == "vehicles":
            given["copies"] = fixed["copies"]
        command = [sys.executable, __file__, str(map_path), "--one", json.dumps(given)]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
        found.append(json.loads(done.stdout.splitlines()[-1]))
        print(
            f"{point:10d}" + "".join(f"{found[-1][c]:9.{DIGITS[c]}f} {UNITS[c]:2s}" for c in columns),
            flush=True,
        )
    last = slice((len(points) - 1) // 2, None)
    slopes = [slope(points[last], [max(f[c], 1e-6) for f in found[last]]) for c in columns]
    print(f"{'exponent':>10s}" + "".join(f"{value:9.2f}   " for value, _ in slopes))
    print(f"{'95 %':>10s}" + "".join(f"{f'+-{width:.2f}':>9s}   " for _, width in slopes))


def slope(points: Sequence[int], values: Sequence[float]) -> tuple[float, float]:
    """Exponent of a power law through measured values, and half the width of its 95 % interval."""
    x, y = np.log(points), np.log(values)
    free = len(points) - 2
    value, first = np.polyfit(x, y, 1)
    residual = y - value * x - first
    spread = np.sqrt((residual**2).sum() / free / ((x - x.mean()) ** 2).sum())
    return float(value), float(stdtrit(free, 0.975) * spread)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path, nargs="?", default=DEFAULT_MAP)
    parser.add_argument(
        "--full", action="store_true", help="to 20 000 futures, 300 vehicles and 400 copies of the map"
    )
    parser.add_argument("--recording", type=Path, help="a crowded recorded moment to run as well")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(options.map, **json.loads(options.one))))
        return
    full = options.full
    base = {"futures": 96, "vehicles": 10, "steps": 30, "copies": 1}
    series("futures", options.map, [30, 100, 300, 1000, *([5000, 20_000] if full else [])], base)
    series("steps", options.map, [30, 40, 60, 80], base)
    vehicles = [5, 10, 30, 100, *([300] if full else [])]
    series("vehicles", options.map, vehicles, {**base, "copies": vehicles[-1] // PER_COPY})
    series("copies", options.map, [1, 4, 16, *([100, 400] if full else [])], base)
    if options.recording:
        recorded(options.recording)


if __name__ == "__main__":
    main()
