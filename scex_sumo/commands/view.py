"""``scex-sumo view`` and ``export``: child scenarios in sumo-gui and in other tools' formats."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scex_sumo.errors import ScexError, UsageError
from scex_sumo.programs import environment, program
from scex_sumo.results.run import Run, open_run
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.world.colors import Rgb, model_colors

if TYPE_CHECKING:
    from scex_sumo.world.gui_drawings import ChildView

FORMATS = ("interaction", "fcd")


def view_command(
    folder: Path, *, child: int | None, grid: int | None, critical: str | None, write_only: bool
) -> None:
    """Write what sumo-gui needs into the result folder, and open it unless told not to."""
    if sum(option is not None for option in (child, grid, critical)) > 1:
        raise UsageError("view: --child, --grid and --critical exclude one another; give one of them")
    run = open_run(folder)
    if grid is not None:
        file = write_grid(run, grid)
    elif critical is not None:
        file = write_child(run, run.most_critical(critical), title=f"most critical by {critical}")
    else:
        file = write_child(run, 0 if child is None else child)
    if write_only:
        print(file)
        return
    if not os.environ.get("DISPLAY") and sys.platform.startswith("linux"):
        raise ScexError(
            f"no display to open sumo-gui on; on a machine that has one: sumo-gui -c {shlex.quote(str(file))}"
        )
    command = [program("sumo-gui"), "-c", str(file)]
    status = subprocess.run(command, check=False, env=environment()).returncode
    if status != 0:
        raise ScexError(f"sumo-gui ended with status {status}; try it by hand: sumo-gui -c {file}")


def export_command(folder: Path, *, child: int, to: str, out: Path | None) -> None:
    """Write one child scenario as a file of another tool."""
    if to not in FORMATS:
        raise UsageError(f"--to {to}: unknown format; known: {', '.join(FORMATS)}")
    run = open_run(folder)
    states = run.states(child)  # says when there is no such child
    ending = "csv" if to == "interaction" else "fcd.xml"
    path = out if out is not None else Path(f"{run.info['seed_scene']['name']}_child{child:04d}.{ending}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if to == "interaction":
            _write_case(run, child, states.shape[1], path)
        else:
            written = write_child(run, child)
            path.write_bytes(written.with_suffix(".fcd.xml").read_bytes())
    except OSError as error:
        raise ScexError(f"{path}: cannot write: {error.strerror or error}") from None
    print(path)


def write_critical(run: Run) -> list[Path]:
    """Files for plain sumo-gui: the most critical child by each metric that is defined in any."""
    from scex_sumo.files import write_atomic

    files = []
    for column in run.columns:
        if column.endswith("_mean") or len(run.samples(column)) == 0:
            continue
        number = run.most_critical(column)
        child = write_child(run, number, title=f"most critical by {column}")
        link = child.with_name(f"critical_{column}.sumocfg")
        write_atomic(link, child.read_bytes())
        files.append(link)
    return files


def write_child(run: Run, number: int, *, title: str = "") -> Path:
    """Files that show one child in plain sumo-gui; returns the one to open."""
    from scex_sumo.views.replay import write_child_view

    view = _child_view(run, number, title)
    return write_child_view(run.net.path.parent, run.net, run.scene, view, _colors(run))


def write_grid(run: Run, count: int) -> Path:
    """Files that show children side by side, spread evenly over their numbers; returns the one to open.

    Raises:
        UsageError: fewer than two children, or more than there are.
    """
    from scex_sumo.views.replay import write_grid_view

    if not 2 <= count <= run.children:
        raise UsageError(f"--grid {count}: give 2 to {run.children}, the number of children")
    numbers = np.unique(np.linspace(0, run.children - 1, count).round().astype(int))
    views = [_child_view(run, int(n), "") for n in numbers]
    return write_grid_view(run.net.path.parent, run.net, run.scene, views, _colors(run))


def _child_view(run: Run, number: int, title: str) -> ChildView:
    from scex_sumo.world.gui_drawings import ChildView

    return ChildView(
        number=number,
        states=run.states(number),
        models=run.models_of(number),
        title=title,
        past=LOGGED_HISTORY,
    )


def _colors(run: Run) -> dict[str, Rgb]:
    names = sorted(set(run.assignments["model"].unique().to_pylist()))
    return dict(zip(names, model_colors(names), strict=True))


def _write_case(run: Run, child: int, frames: int, path: Path) -> None:
    """One child as an INTERACTION v1.2 case."""
    from pyarrow import csv

    vehicles = len(run.info["seed_scene"]["track_ids"])
    rows = run.tracks.slice(child * vehicles * frames, vehicles * frames)
    csv.write_csv(rows, path, csv.WriteOptions(quoting_style="none", quoting_header="none"))
