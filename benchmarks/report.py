"""Time and size of ``report.html``: of a real run, and of one whose children all differ.

    python benchmarks/report.py [OUT]

Without a result folder, 385 children of the example roundabout are run first. Measured is what ``run`` adds
after its table, whose intervals the report takes over: processor time, the best and the first of several
repetitions.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo import example_path, open_run
from scex_sumo.reports.page import contents
from scex_sumo.reports.page.html import asset
from scex_sumo.reports.page.packing import second_differences, second_sums
from scex_sumo.reports.page.report import SCRIPTS, write_report
from scex_sumo.reports.page.scene import UniqueTracks, unique_tracks
from scex_sumo.reports.run_table import summary_table
from scex_sumo.results.run import Run

REPEATS = 5


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "out"
        if len(sys.argv) < 2:
            command = [sys.executable, "-m", "scex_sumo", "run", str(example_path("roundabout"))]
            subprocess.run([*command, "--no-report", "-o", str(folder)], check=True, capture_output=True)
        print(f"scripts: {sum(len(asset(name)) for name in SCRIPTS) / 1000:.1f} kB")
        measure("as run", folder)
        contents.unique_tracks = all_different
        measure("all different", folder)


def measure(name: str, folder: Path) -> None:
    times = []
    for _ in range(REPEATS):
        run = open_run(folder)
        summary_table(run)
        start = time.process_time()
        path = write_report(run)
        times.append(time.process_time() - start)
    kept = f"{run.children} children of {len(run.info['seed_scene']['track_ids'])} vehicles"
    print(f"{name}: {kept}: {path.stat().st_size / 1000:.0f} kB, {min(times):.3f} s (first {times[0]:.3f} s)")


def all_different(run: Run) -> UniqueTracks:
    """The tracks of a run, every one with smooth accelerations and turns of its own."""
    found = unique_tracks(run)
    rng = np.random.default_rng(0)
    rows = found.which.reshape(-1)
    moved = second_sums(found.motion)[rows]
    drift = rng.normal(0, 1, (len(rows), moved.shape[1], 3)) * np.array([1.0, 1.0, 1.0])
    drift += rng.normal(0, 2, (len(rows), 1, 3))
    different = moved + np.rint(np.cumsum(np.cumsum(drift, axis=1) * 0.1, axis=1)).astype(int)
    which = np.arange(len(rows)).reshape(found.which.shape)
    return replace(found, motion=second_differences(different), which=which)


if __name__ == "__main__":
    main()
