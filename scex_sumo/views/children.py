"""Children of a run as files for plain sumo-gui: one, several side by side, or the most critical ones."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from scex_sumo.errors import UsageError
from scex_sumo.files import write_atomic
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY
from scex_sumo.views.replay import write_view
from scex_sumo.world.colors import model_colors
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
    return _write(run, {number: title})


def write_grid(run: Run, count: int) -> Path:
    """Files that show children side by side, spread evenly over their numbers; returns the one to open.

    Raises:
        UsageError: fewer than two children, or more than there are.
    """
    if not 2 <= count <= run.children:
        raise UsageError(f"--grid {count}: give 2 to {run.children}, the number of children")
    numbers = np.unique(np.linspace(0, run.children - 1, count).round().astype(int))
    return _write(run, dict.fromkeys(numbers.tolist(), ""))


def _write(run: Run, titles: Mapping[int, str]) -> Path:
    """Files that show children under titles."""
    views = [
        ChildView(number=n, states=run.states(n), models=run.models_of(n), title=title, past=LOGGED_HISTORY)
        for n, title in titles.items()
    ]
    names = sorted(set(run.assignments["model"].unique().to_pylist()))
    colors = dict(zip(names, model_colors(names), strict=True))
    return write_view(run.net.path.parent, run.net, run.scene, views, colors)
