"""One seed from map to result folder: how long each stage takes, and how that compares with the bare loop.

Everything in one process, interleaved, processor time, medians: bare loops over the very poses of the run
(see `bare_loop`), then a whole run: map and tracks read, converted, simulated, measured, densities and files
written.

    python benchmarks/one_seed.py [MAP.osm] [--futures 385] [--vehicles 11] [--steps 30] [--models all]
        [--repeat 5] [--workers 2] [--start]
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from bare_loop import DEFAULT_MAP, WAYS, Poses, bare_loop, poses_of

import scex_sumo
from scex_sumo.behaviors.registry import DEFAULT_MODELS
from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.results.run import Run
from scex_sumo.scenarios.populated import synthetic_seed
from scex_sumo.scene import SeedScene, States
from scex_sumo.world.session import load_sumo

SIX = f"{DEFAULT_MODELS},graph_predictor,graph_image_predictor"
PACKAGE = Path(scex_sumo.__file__).parent


def rooms(work: Callable[[], object]) -> Counter[str]:
    """Processor time of some work by package of ours, s.

    Each function's own time counts for its package, that of libraries for whoever calls them; the profile's
    shares of the time that the work takes without one.
    """
    begin = time.process_time()
    work()
    whole = time.process_time() - begin
    profile = cProfile.Profile(time.process_time)
    profile.runcall(work)
    spent: Counter[str] = Counter()
    for (file, _, _), (_, _, own, _, callers) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        if _room(file) is not None or not callers:
            spent[_room(file) or "rest"] += own
            continue
        for (caller, _, _), (_, _, part, _) in callers.items():
            spent[_room(caller) or "libraries"] += part
    total = sum(spent.values())
    return Counter({room: whole * part / total for room, part in spent.items()})


def _room(file: str) -> str | None:
    """The package that a file of ours is in."""
    path = Path(file)
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py") if path.is_relative_to(PACKAGE) else None


def whole_run(map_path: Path, tracks: Path, out: Path, options: argparse.Namespace, workers: int = 1) -> Run:
    """What ``scex-sumo run`` does, without its summary and pictures."""
    scene = scex_sumo.read_seed(map_path, tracks=tracks, case="1.0")
    return scex_sumo.extrapolate(
        scene,
        models=options.models,
        reference=None,
        report=False,
        futures=options.futures,
        steps=options.steps,
        replan=options.replan,
        workers=workers,
        out=out,
        overwrite=True,
        seed=0,
    )


def poses_of_run(run: Run, scene: SeedScene) -> Poses:
    """(C, T + 1, V) of all futures of a run, the seed scene first."""
    frames = run.info["steps"] + 10
    shape = (run.futures, scene.vehicles, frames)
    columns = {
        name: np.asarray(run.tracks[column]).reshape(shape)[:, :, 9:].swapaxes(1, 2)
        for name, column in (("x", "x"), ("y", "y"), ("heading", "psi_rad"))
    }
    return poses_of(States(**columns, speed=np.zeros_like(columns["x"])), scene.length)


def start_times(map_path: Path, tracks: Path) -> dict[str, float]:
    """Wall time of commands from the start of the interpreter, s."""
    first_step = (
        "import os, scex_sumo\n"
        f"seed = scex_sumo.read_seed({str(map_path)!r}, tracks={str(tracks)!r}, case='1.0')\n"
        "scex_sumo.extrapolate(seed, progress=lambda done, total: done and os._exit(0))\n"
    )
    commands = {
        "scex-sumo --help": [sys.executable, "-m", "scex_sumo", "--help"],
        "run up to its first step": [sys.executable, "-c", first_step],
    }
    found = {}
    for name, command in commands.items():
        walls = []
        for _ in range(3):
            begin = time.perf_counter()
            subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
            walls.append(time.perf_counter() - begin)
        found[name] = min(walls)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path, nargs="?", default=DEFAULT_MAP)
    parser.add_argument("--futures", type=int, default=385)
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--replan", type=int, default=5)
    parser.add_argument("--models", default=DEFAULT_MODELS, help=f"'all' for {SIX}")
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--workers", type=int, default=0, help="also the wall time with so many processes")
    parser.add_argument("--start", action="store_true", help="also what passes until the first step")
    options = parser.parse_args()
    options.models = SIX if options.models == "all" else options.models
    scene = synthetic_seed(options.map, vehicles=options.vehicles)
    total = options.futures * options.vehicles * options.steps
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tracks = write_tracks(folder / "tracks.csv", scene)
        load_sumo()
        first = whole_run(options.map, tracks, folder / "out", options)  # imports and caches of the process
        poses = poses_of_run(first, scene)
        net = first.net.path
        bare: dict[str, list[float]] = {way: [] for way in WAYS}
        runs = []
        for _ in range(options.repeat):
            for way, loops in bare.items():
                loops.append(sum(bare_loop(net, poses, way).values()))
            runs.append(rooms(lambda: whole_run(options.map, tracks, folder / "out", options)))
        size = f"{options.futures} futures x {options.vehicles} vehicles x {options.steps} steps"
        print(f"{options.map.stem}, {size}")
        print(f"models: {options.models}\n")
        report(bare, runs, total)
        if options.workers:
            walls = [_wall(options, tracks, folder, workers) for workers in (1, options.workers)]
            print(f"\nwall time: one process {walls[0]:.2f} s, {options.workers} processes {walls[1]:.2f} s")
        if options.start:
            for what, seconds in start_times(options.map, tracks).items():
                print(f"{what}: {seconds:.2f} s from the start of the interpreter")
    print(f"peak memory of this process {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


def _wall(options: argparse.Namespace, tracks: Path, folder: Path, workers: int) -> float:
    walls = []
    for _ in range(options.repeat):
        begin = time.perf_counter()
        whole_run(options.map, tracks, folder / "out", options, workers)
        walls.append(time.perf_counter() - begin)
    return statistics.median(walls)


def report(bare: dict[str, list[float]], runs: list[Counter[str]], total: int) -> None:
    """The table by package: seconds, microseconds per vehicle-step, share of the whole run."""
    whole = statistics.median(sum(run.values()) for run in runs)
    print(f"{'':22s} {'s':>7s} {'us':>7s} {'share':>6s}")
    for name, _ in sum(runs, Counter()).most_common(12):
        seconds = statistics.median(run[name] for run in runs)
        print(f"{name:22s} {seconds:7.3f} {1e6 * seconds / total:7.2f} {seconds / whole:6.1%}")
    print(f"{'whole run':22s} {whole:7.3f} {1e6 * whole / total:7.2f}")
    for way, loops in bare.items():
        seconds = statistics.median(loops)
        ratio = statistics.median(sum(run.values()) / loop for run, loop in zip(runs, loops, strict=True))
        name = f"bare loop {way}"
        print(f"{name:22s} {seconds:7.3f} {1e6 * seconds / total:7.2f}   run: {ratio:.2f} x")


if __name__ == "__main__":
    main()
