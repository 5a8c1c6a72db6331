"""Children of a run as files for plain sumo-gui: one, several side by side, or the most critical ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.errors import UsageError
from scex_sumo.files import write_atomic
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.views.replay import write_child_view, write_grid_view
from scex_sumo.world.colors import Rgb, model_colors
from scex_sumo.world.gui_drawings import ChildView


def write_critical(run: Run) -> list[Path]:
    """Files for plain sumo-gui: the most critical child by each metric that is defined in any."""
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
    view = _child_view(run, number, title)
    return write_child_view(run.net.path.parent, run.net, run.scene, view, _colors(run))


def write_grid(run: Run, count: int) -> Path:
    """Files that show children side by side, spread evenly over their numbers; returns the one to open.

    Raises:
        UsageError: fewer than two children, or more than there are.
    """
    if not 2 <= count <= run.children:
        raise UsageError(f"--grid {count}: give 2 to {run.children}, the number of children")
    numbers = np.unique(np.linspace(0, run.children - 1, count).round().astype(int))
    views = [_child_view(run, int(n), "") for n in numbers]
    return write_grid_view(run.net.path.parent, run.net, run.scene, views, _colors(run))


def _child_view(run: Run, number: int, title: str) -> ChildView:
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
