"""Time, size and frames per second of ``report.html``: of a real run, and of one whose futures all differ.

    python benchmarks/report.py [OUT]

Without a result folder, 385 futures of the example roundabout are run first. Measured is what ``run`` adds
after its table, whose intervals the report takes over: processor time, the best and the first of several
repetitions. Frames are those of chromium without a GPU in two seconds of play at 1400 x 900: zoomed to the
worst encounter, with the whole scene, and with all futures; they need playwright.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from scex_sumo import example_path, open_run
from scex_sumo.page.html import asset
from scex_sumo.page.report import scene
from scex_sumo.page.report.report import REPORT, SCRIPTS, write_report
from scex_sumo.page.report.scene import Future, poses_of
from scex_sumo.reports.run_table import summary_table

REPEATS = 5
FRAMES = """() => new Promise((done) => {
    const times = [], on = (now) => {
        times.push(now);
        if (now - times[0] < 2000) requestAnimationFrame(on);
        else done(1000 * (times.length - 1) / (now - times[0]));
    };
    const slider = document.getElementById("time");
    slider.value = 0;
    slider.dispatchEvent(new Event("input"));
    document.getElementById("play").click();
    requestAnimationFrame(on);
})"""


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "out"
        if len(sys.argv) < 2:
            command = [sys.executable, "-m", "scex_sumo", "run", str(example_path("roundabout"))]
            subprocess.run([*command, "--no-report", "-o", str(folder)], check=True, capture_output=True)
        print(f"scripts: {sum(len(asset(name)) for name in SCRIPTS) / 1000:.1f} kB")
        measure("as run", folder)
        measure_frames(folder / REPORT)
        scene.poses_of = all_different
        measure("all different", folder)
        measure_frames(folder / REPORT)


def measure(name: str, folder: Path) -> None:
    times = []
    for _ in range(REPEATS):
        run = open_run(folder)
        summary_table(run)
        start = time.process_time()
        path = write_report(run)
        times.append(time.process_time() - start)
    kept = f"{run.futures} futures of {len(run.info['seed_scene']['track_ids'])} vehicles"
    print(f"{name}: {kept}: {path.stat().st_size / 1000:.0f} kB, {min(times):.3f} s (first {times[0]:.3f} s)")


def measure_frames(path: Path) -> None:
    with sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.goto(path.resolve().as_uri())
        page.wait_for_selector("#encounters tr")
        rates = []
        for key in ("", "f", "a"):
            if key:
                page.keyboard.press(key)
            page.wait_for_timeout(1500)
            rates.append(f"{page.evaluate(FRAMES):.0f}")
        browser.close()
    print("  frames per second: {} at the encounter, {} of the scene, {} of all futures".format(*rates))


def all_different(futures: Sequence[Future]) -> np.ndarray:
    """The poses of futures, every track with smooth accelerations and turns of its own."""
    poses, rng = poses_of(futures), np.random.default_rng(0)
    time_s = 0.1 * np.arange(poses.shape[2])[:, None]
    rate = rng.normal(0, [0.05, 0.05, 0.005, 0.05], (*poses.shape[:2], 1, 4))
    drift = rng.normal(0, [0.02, 0.02, 0.002, 0.02], poses.shape)
    drift[:, :, 0] = 0
    return poses + rate * time_s + np.cumsum(0.1 * np.cumsum(drift, axis=2), axis=2)


if __name__ == "__main__":
    main()
