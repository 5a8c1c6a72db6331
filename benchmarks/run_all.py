"""Measure speed and growth, and write the tables into ``benchmarks/README.md`` with the machine that it was.

    python benchmarks/run_all.py [--map MAP.osm] [--full] [--only one_seed] [--peers FOLDER]

Without ``--full`` it takes some four minutes of two cores. ``--map`` names a map to measure besides the
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", type=Path, help="a map to measure besides the project's own roundabout")
    parser.add_argument("--full", action="store_true", help="more repetitions, 10 000 children")
    parser.add_argument("--only", choices=("one_seed", "scaling", "peers", "report"))
    parser.add_argument("--peers", type=Path, help="folder of the peers' virtual environments")
    options = parser.parse_args()
    maps = [[str(options.map)]] if options.map else []
    repeat = "9" if options.full else "5"
    if options.only is None:
        put("machine", machine())
    if options.only in (None, "one_seed"):
        parts = []
        for chosen in [*maps, []]:
            start = ["--start"] if not parts else []
            parts.append(measured("one_seed.py", *chosen, "--workers", "2", "--repeat", repeat, *start))
        chosen = maps[0] if maps else []
        parts.append(measured("one_seed.py", *chosen, "--models", "all", "--workers", "2", "--repeat", "2"))
        put("one_seed", "\n\n".join(parts))
    if options.only in (None, "scaling"):
        put(
            "scaling",
            measured("scaling.py", *(maps[0] if maps else []), *(["--full"] if options.full else [])),
        )
    if options.only in (None, "report"):
        put("report", measured("report.py"))
    if options.only in (None, "peers"):
        put("peers", measured("peers.py", *(["--folder", str(options.peers)] if options.peers else [])))


if __name__ == "__main__":
    main()
