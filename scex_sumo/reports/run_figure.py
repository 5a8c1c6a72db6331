"""Figure of a run for a paper: the density or cumulative curve of one metric, or of all."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from scex_sumo.reports.run_pictures import LABELS, STYLE, cumulative_panel, density_panel
from scex_sumo.results.run import Run

_PANEL_IN = (2.9, 2.3)
_ACROSS = 4


def draw_figure(run: Run, curve: str, path: Path, *, metric: str | None = None) -> Path:
    """Draw a figure; one layout for all that is in it.

    Args:
        run: a finished run.
        curve: ``density`` or ``cumulative``.
        path: SVG, PNG or PDF file.
        metric: one column; None draws all of them.
    """
    columns = run.columns if metric is None else [metric]
    for column in columns:
        run.samples(column)  # says which metrics there are
    across = min(_ACROSS, len(columns))
    down = math.ceil(len(columns) / across)
    size = (_PANEL_IN[0] * across, _PANEL_IN[1] * down)
    panel = density_panel if curve == "density" else cumulative_panel
    with plt.rc_context(STYLE):
        figure, grid = plt.subplots(down, across, figsize=size, layout="constrained", squeeze=False)
        for axes, column in zip(grid.flat, columns, strict=False):
            axes.set_xlabel(LABELS[column.removesuffix("_mean")])
            if column.endswith("_mean"):
                axes.set_title("mean of scenes", loc="left")
            if np.isfinite(run.samples(column)).any():
                panel(run, column, axes)
            else:
                axes.text(0.5, 0.5, "defined in no child", ha="center", va="center", transform=axes.transAxes)
        for axes in grid.flat[len(columns) :]:
            axes.set_axis_off()
        figure.supylabel("density" if curve == "density" else "cumulative density")
        # A file without a date: the same run gives the same bytes.
        metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
        figure.savefig(path, dpi=200, metadata=metadata)
        plt.close(figure)
    return path
