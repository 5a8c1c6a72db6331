"""Measure speed and growth, and write the tables into ``benchmarks/README.md`` with the machine that it was.

    python benchmarks/run_all.py [--map MAP.osm] [--dataset FOLDER [--before CHECKOUT]] [--recording FILE]
        [--full] [--only whole_command] [--peers FOLDER]

It takes some ten minutes of two cores, with ``--full`` fifteen. ``--map`` names a map to measure besides the
project's own roundabout, e.g. one of the INTERACTION dataset; it is populated by SUMO.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import time
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).parent
README = HERE / "README.md"
PACKAGES = ("libsumo", "numpy", "scipy", "pyarrow", "lanelet2")


def machine() -> str:
    """Processor, cores, memory, system, versions, and how busy it was."""
    cpu = platform.processor() or "unknown processor"
    info = Path("/proc/cpuinfo")
    if info.exists() and (found := re.search(r"model name\s*: (.*)", info.read_text())):
        cpu = found[1]
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return (
        f"{cpu}, {os.cpu_count()} cores, {memory:.0f} GiB; {platform.system()} {platform.release()}, "
        f"Python {platform.python_version()}, {packages}. "
        f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC, load average before {os.getloadavg()[0]:.1f}."
    )


def measured(script: str, *arguments: str) -> str:
    """What a benchmark prints."""
    begin = time.perf_counter()
    command = [sys.executable, str(HERE / script), *arguments]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, text=True, check=True, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    print(f"{script} {' '.join(arguments)}: {time.perf_counter() - begin:.0f} s", file=sys.stderr)
    shown = " ".join(Path(word).name if os.sep in word else word for word in arguments)
    return f"```\n$ python benchmarks/{script} {shown}".rstrip() + f"\n{done.stdout.strip()}\n```"


def put(name: str, content: str) -> None:
    """Replace what stands between the marks of a block of the README."""
    text = README.read_text(encoding="utf-8")
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"{README}: has no block {name}")
    README.write_text(pattern.sub(lambda found: f"{found[1]}{content}\n{found[2]}", text), encoding="utf-8")


def commands(options: argparse.Namespace) -> str:
    """The whole command on the example, on a map that SUMO populates, and ranked recordings."""
    repeat = ["--repeat", "5" if options.full else "3", "--workers", "2"]
    ranking = ["--dataset", str(options.dataset)] if options.dataset else []
    if options.dataset and options.before:
        ranking += ["--before", str(options.before)]
    parts = [measured("whole_command.py", *repeat, *ranking)]
    if options.map:
        parts.append(measured("whole_command.py", str(options.map), "--synthetic", "11", *repeat))
    return "\n\n".join(parts)


def one_seed(options: argparse.Namespace) -> str:
    """The run by part against the loops, with four and with six models, and the worlds alone."""
    chosen = [str(options.map)] if options.map else []
    repeat = ["--repeat", "9" if options.full else "3"]
    return "\n\n".join(
        [
            measured("one_seed.py", *chosen, "--models", "rules", *repeat, "--start"),
            measured("one_seed.py", *chosen, "--models", "paper", *repeat),
            measured("bare_loop.py", *chosen),
        ]
    )


def scaling(options: argparse.Namespace) -> str:
    """Growth, and a crowded recording."""
    recording = ["--recording", str(options.recording)] if options.recording else []
    chosen = [str(options.map)] if options.map else []
    return measured("scaling.py", *chosen, *(["--full"] if options.full else []), *recording)


def report(options: argparse.Namespace) -> str:
    """The page of a run: size and processor time."""
    return measured("report.py")


def exhaustive(options: argparse.Namespace) -> str:
    """Every combination of six models for five vehicles."""
    return measured("exhaustive.py")


def peers(options: argparse.Namespace) -> str | None:
    """Other projects, where their environments are."""
    return measured("peers.py", "--folder", str(options.peers)) if options.peers else None


BLOCKS = {
    "whole_command": commands,
    "one_seed": one_seed,
    "scaling": scaling,
    "report": report,
    "exhaustive": exhaustive,
    "peers": peers,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", type=Path, help="a map to measure besides the project's own roundabout")
    parser.add_argument("--dataset", type=Path, help="recordings to rank")
    parser.add_argument("--before", type=Path, help="an older checkout, to rank with as well")
    parser.add_argument("--recording", type=Path, help="a crowded recorded moment")
    parser.add_argument("--full", action="store_true", help="more repetitions, 10 000 futures")
    parser.add_argument("--only", choices=BLOCKS)
    parser.add_argument("--peers", type=Path, help="folder of the peers' virtual environments")
    options = parser.parse_args()
    if options.only is None:
        put("machine", machine())
    for name, block in BLOCKS.items():
        if options.only in (None, name) and (text := block(options)) is not None:
            put(name, text)


if __name__ == "__main__":
    main()
