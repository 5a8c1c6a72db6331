"""One future in sumo-gui beside the same one drawn from exported files, for docs/handover.md.

Run: ``python docs/handover_picture.py``; needs a screen or Xvfb, and the extra ``formats``.
Right: nothing but the ``.xodr`` and ``.xosc``, read by the readers of the tests, which share no code with the
writers.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import sumo
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Polygon

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import scex_sumo as scex  # noqa: E402
from scex_sumo.base.colors import OTHER_RGB, model_colors  # noqa: E402
from scex_sumo.base.errors import MissingExtraError  # noqa: E402
from scex_sumo.exporters.openscenario import write_openscenario  # noqa: E402
from scex_sumo.exporters.request import Request  # noqa: E402
from scex_sumo.results.run import Run  # noqa: E402
from scex_sumo.scene import LOGGED_HISTORY, STEP_S  # noqa: E402
from scex_sumo.views.replay import FutureView, write_view  # noqa: E402
from tests.exporters.opendrive_reader import OpenDrive  # noqa: E402
from tests.exporters.openscenario_reader import box_centres  # noqa: E402

PICTURE = ROOT / "docs" / "images" / "handover.png"
STEP = LOGGED_HISTORY - 1 + 15  # a second and a half after the seed scene
MIDDLE, AROUND_M = np.array([1005.0, 1012.0]), 48.0


def main() -> None:
    """Run, show, export, read, draw."""
    run = scex.extrapolate(
        scex.read_seed(scex.example_path("urban_intersection")), futures=40, reference=None
    )
    future = 3
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        figure = Figure(figsize=(13, 6.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        shot = imread(in_sumo_gui(run, future, folder))
        beside = max(shot.shape[1] - shot.shape[0], 0) // 2
        left.imshow(shot[:, beside : shot.shape[1] - beside])
        left.set_axis_off()
        left.set_title("the future in sumo-gui", loc="left")
        draw_export(right, run, future, folder)
        figure.savefig(PICTURE, dpi=90)


def in_sumo_gui(run: Run, future: int, folder: Path) -> Path:
    """Picture that sumo-gui takes of a future."""
    models = sorted(set(run.assignments["model"].unique().to_pylist()))
    now = run.states(future)[:, STEP]
    near = np.flatnonzero(np.hypot(now.x - MIDDLE[0], now.y - MIDDLE[1]) < AROUND_M / 2)
    view = FutureView(
        number=future,
        states=run.states(future),
        models=run.models_of(future),
        past=LOGGED_HISTORY,
        event=near.tolist(),
        stop=STEP,
    )
    colors = dict(zip(models, model_colors(models), strict=True))
    shots = ((STEP * STEP_S, "future.png"),)
    configuration = write_view(folder, run.net, run.scene, [view], colors, snapshots=shots)
    screen = [] if os.environ.get("DISPLAY") else ["xvfb-run", "-a", "-s", "-screen 0 1200x1100x24"]
    if screen and shutil.which(screen[0]) is None:
        raise MissingExtraError("sumo-gui needs a screen or Xvfb (apt-get install xvfb)")
    program = Path(sumo.SUMO_HOME) / "bin" / "sumo-gui"
    environment = {**os.environ, "SUMO_HOME": sumo.SUMO_HOME}
    command = [*screen, str(program), "-c", configuration.name, "--quit-on-end"]
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    return folder / "future.png"


def draw_export(axes: Axes, run: Run, future: int, folder: Path) -> None:
    """The same future from the exported files alone."""
    road, scenario, *_ = write_openscenario(Request(run=run, futures=(future,), out=folder / "export"))
    for lane in OpenDrive(road.read_text()).lanes:
        surface = np.vstack([lane.left, lane.right[::-1]])
        axes.add_patch(Polygon(surface, facecolor="#d9dde2", edgecolor="#8a929c", linewidth=0.7))
    boxes = box_centres(scenario, STEP_S * np.arange(STEP + 1))
    models = sorted(set(run.assignments["model"].unique().to_pylist()))
    colors = dict(zip(models, model_colors(models), strict=True))
    for entity in ElementTree.parse(scenario).getroot().iter("ScenarioObject"):
        name, size = entity.get("name", ""), entity.find(".//BoundingBox/Dimensions")
        driver = entity.find(".//Property[@name='model']")
        assert size is not None and driver is not None
        length, width = (float(size.get(key, "nan")) for key in ("length", "width"))
        box = boxes[name]
        x, y, heading = box[-1]
        corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * (length / 2, width / 2)
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        color = np.array(colors.get(driver.get("value", ""), OTHER_RGB)) / 255
        axes.add_patch(Polygon(corners @ turn + (x, y), facecolor=color, edgecolor="black", linewidth=0.5))
        axes.plot(*box[:, :2].T, color=color, linewidth=1)
        axes.annotate(name.removeprefix("vehicle").replace("other", "P"), (x, y), fontsize=7)
    axes.set(xlim=MIDDLE[0] + np.array([-1, 1]) * AROUND_M, ylim=MIDDLE[1] + np.array([-1, 1]) * AROUND_M)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title(f"read from {scenario.suffix} and {road.suffix} by a reader of its own", loc="left")


if __name__ == "__main__":
    main()
