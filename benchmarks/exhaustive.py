"""Exhaustive study: every combination of six models for five vehicles, 7 776 futures.

python benchmarks/exhaustive.py [--vehicles 5] [--models paper]
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
from pathlib import Path

from bare_loop import DEFAULT_MAP
from whole_command import spent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicles", type=int, default=5)
    parser.add_argument("--models", default="paper")
    options = parser.parse_args()
    seed = [str(DEFAULT_MAP), "--synthetic", str(options.vehicles)]
    with tempfile.TemporaryDirectory() as folder:
        run = [
            sys.executable,
            "-m",
            "scex_sumo",
            "run",
            *seed,
            "--models",
            options.models,
            "-o",
            f"{folder}/out",
        ]
        seconds, wall, _ = spent([*run, "--futures", "all", "--reference", "none"])
        memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file()) / 1e6
    print(f"{seconds:.1f} s of processor time, {wall:.1f} s, at most {memory:.0f} MB, folder {size:.0f} MB")


if __name__ == "__main__":
    main()
