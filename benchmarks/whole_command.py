"""Whole command: processor time from the start of the interpreter to its exit, against the plain bare loop.

What a person waits for: imports, map, conversion, simulation, metrics, densities, files and report, in one
process. The plain bare loop is libsumo as its documentation has it, over as many vehicle-steps (see
`bare_loop`). Commands and loops are interleaved; medians.

    python benchmarks/whole_command.py [MAP.osm] [--repeat 3] [--workers 2] [--options='--no-plots']
"""

from __future__ import annotations

import argparse
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
    "a run of one child": ["--children", "1"],
}
GOALS = {"four rule-based models": 1.0, "the paper's six": 2.0, "a run of one child": 0.3}
LOOP = Path(__file__).with_name("bare_loop.py")


def spent(command: list[str]) -> tuple[float, float, str]:
    """Processor time and wall time of a command and all that it starts, s, and what it printed."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall, done.stdout


def plain_loop(map_path: Path) -> float:
    """Seconds of the plain loop alone, without the start of its interpreter."""
    printed = spent([sys.executable, str(LOOP), str(map_path), "--way", "plain"])[2]
    return next(float(line.split()[1]) for line in printed.splitlines() if line.startswith("all"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("map", type=Path, nargs="?", default=DEFAULT_MAP)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--workers", type=int, default=0, help="also the wall time with so many processes")
    parser.add_argument("--options", default="", help="of all commands, e.g. --options='--no-plots'")
    options = parser.parse_args()
    loops: list[float] = []
    cpu: dict[str, list[float]] = {name: [] for name in COMMANDS}
    wall: dict[tuple[str, int], list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(options.repeat):
            loops.append(plain_loop(options.map))
            for name, own in COMMANDS.items():
                run = [sys.executable, "-m", "scex_sumo", "run", str(options.map), "-o", f"{folder}/out"]
                run += ["--overwrite", *own, *options.options.split()]
                for workers in {1, options.workers or 1}:
                    seconds, waited, _ = spent([*run, "--workers", str(workers)])
                    wall.setdefault((name, workers), []).append(waited)
                    if workers == 1:
                        cpu[name].append(seconds)
    loop = statistics.median(loops)
    print(f"plain bare loop: {loop:.2f} s of processor time\n")
    print("| whole command | processor time | against the loop | to reach |\n|---|---|---|---|")
    for name, each in cpu.items():
        seconds = statistics.median(each)
        print(f"| {name} | {seconds:.2f} s | {seconds / loop:.2f} x | {GOALS[name]:.1f} x |")
    if options.workers > 1:
        print(f"\n| wall time | 1 process | {options.workers} processes | faster |\n|---|---|---|---|")
        for name in list(COMMANDS)[:2]:
            one, more = (statistics.median(wall[name, count]) for count in (1, options.workers))
            print(f"| {name} | {one:.2f} s | {more:.2f} s | {one / more:.2f} x |")


if __name__ == "__main__":
    main()
