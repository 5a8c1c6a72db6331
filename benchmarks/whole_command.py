"""Whole command: processor time from the start of the interpreter to its exit, against the plain bare loop.

What a person waits for: imports, map, conversion, simulation, metrics, densities, files, likely reference and
report, in one process. The plain bare loop is libsumo as its documentation has it, over as many vehicle-steps
(see `bare_loop`). Commands and loops are interleaved, after a first round that compiles and keeps the net;
medians.

    python benchmarks/whole_command.py [MAP.osm --synthetic 11] [--repeat 3] [--workers 2]
    python benchmarks/whole_command.py --loaded    # modules and lines of the package that commands load
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bare_loop import DEFAULT_MAP

COMMANDS = {
    "four rule-based models": ["--models", "rules"],
    "the paper's six": ["--models", "paper"],
    "a run of one future": ["--futures", "1"],
    "a run of one future, --reference none": ["--futures", "1", "--reference", "none"],
}
GOALS = dict(zip(COMMANDS, (0.55, 1.2, 0.3, 0.3), strict=True))
RUN = "run", str(DEFAULT_MAP), "--workers", "1"
LOADED = {
    "a default run": ["run", str(DEFAULT_MAP), "--futures", "4"],
    "a bare run": [
        "run",
        *(str(DEFAULT_MAP), "--futures", "4", "--models", "rules"),
        "--reference",
        "none",
        "--no-report",
    ],
    "import of the Intelligent Driver Model": [],
}
COUNT = """
import atexit, sys
def count():
    ours = [module for name, module in sys.modules.items() if name.startswith("scex_sumo")]
    files = [module.__file__ for module in ours if str(getattr(module, "__file__", "")).endswith(".py")]
    lines = [sum(1 for _ in open(file)) for file in files]
    print("LOADED", sum(lines), sum(n > 15 for n in lines))
atexit.register(count)
if len(sys.argv) == 1:
    import scex_sumo.behaviors.models.idm
else:
    from scex_sumo.cli import main
    main()
"""
HERE = Path(__file__).resolve().parent
STEPS = 30


def spent(command: list[str], tree: Path = HERE.parent) -> tuple[float, float, str]:
    """Processor time and wall time of a command and all that it starts, s, and what it printed.

    It runs as installed: with the package of ``tree``, and with bytecode kept between runs. Its folder is
    ``tree`` as well, since Python looks for packages there before anywhere else.
    """
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = {**kept, "PYTHONPATH": str(tree)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tree)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall, done.stdout


def plain_loop(map_path: Path, vehicles: int) -> float:
    """Seconds of the plain loop alone, without the start of its interpreter."""
    options = [str(map_path), "--vehicles", str(vehicles)]
    printed = spent([sys.executable, str(HERE / "bare_loop.py"), *options])[2]
    return next(float(line.split()[1]) for line in printed.splitlines() if line.startswith("all"))


def _absolute(path: str) -> Path:
    return Path(path).resolve()


def loaded(folder: Path) -> None:
    """Print the lines and modules (longer than 15 lines) that commands load, their caches warm."""
    for name, given in LOADED.items():
        out = ["-o", f"{folder}/out", "--overwrite", "-q"] if given else []
        printed = [spent([sys.executable, "-c", COUNT, *given, *out])[2] for _ in range(2)][1]
        _, lines, modules = printed.splitlines()[-1].split()
        print(f"{name}: {int(lines):,} lines in {modules} modules")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=_absolute, nargs="?", default=DEFAULT_MAP)
    parser.add_argument("--synthetic", type=int, help="vehicles that SUMO places on the map")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--workers", type=int, default=0, help="also the wall time with so many processes")
    parser.add_argument("--loaded", action="store_true", help="what commands load, alone")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        loaded(Path(folder)) if options.loaded else commands(options, Path(folder))


def commands(options: argparse.Namespace, folder: Path) -> None:
    """The tables of processor time and wall time."""
    seed = [str(options.map), *(["--synthetic", str(options.synthetic)] if options.synthetic else [])]
    loops: list[float] = []
    cpu: dict[str, list[float]] = {name: [] for name in COMMANDS}
    wall: dict[tuple[str, int], list[float]] = {}
    vehicles = options.synthetic or 14
    for turn in range(options.repeat + 1):
        loops.append(plain_loop(options.map, vehicles))
        for name, own in COMMANDS.items():
            run = [
                sys.executable,
                "-m",
                "scex_sumo",
                "run",
                *seed,
                "-o",
                f"{folder}/out",
                "--overwrite",
                *own,
            ]
            for workers in sorted({1, options.workers or 1}) if name in list(COMMANDS)[:2] else (1,):
                seconds, waited, _ = spent([*run, "--workers", str(workers)])
                if turn:
                    wall.setdefault((name, workers), []).append(waited)
                if turn and workers == 1:
                    cpu[name].append(seconds)
    loop = statistics.median(loops[1:])
    print(f"{options.map.stem}, 385 futures x {vehicles} vehicles x {STEPS} steps")
    print(f"plain bare loop: {loop:.2f} s of processor time\n")
    print("| whole command | processor time | against the loop | to reach |\n|---|---|---|---|")
    for name, each in cpu.items():
        seconds = statistics.median(each)
        print(f"| {name} | {seconds:.2f} s | {seconds / loop:.2f} x | {GOALS[name]:.2f} x |")
    if options.workers > 1:
        print(f"\n| wall time | 1 process | {options.workers} processes | faster |\n|---|---|---|---|")
        for name in list(COMMANDS)[:2]:
            one, more = (statistics.median(wall[name, count]) for count in (1, options.workers))
            print(f"| {name} | {one:.2f} s | {more:.2f} s | {one / more:.2f} x |")


if __name__ == "__main__":
    main()
