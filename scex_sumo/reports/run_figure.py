"""Figure of a run for a paper: the density or cumulative curve of one metric, or of all."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from scex_sumo.reports.run_pictures import (
    STYLE,
    axis_label,
    cumulative_panel,
    density_panel,
    panel_grid,
    panel_title,
)
from scex_sumo.results.run import Run

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
    panel = density_panel if curve == "density" else cumulative_panel
    with plt.rc_context(STYLE):
        figure, grid = panel_grid(len(columns), across=across)
        for axes, column in zip(grid.flat, columns, strict=False):
            axes.set_xlabel(axis_label(column))
            axes.set_title(panel_title(column), loc="left")
            if np.isfinite(run.samples(column)).any():
                panel(run, column, axes)
            else:
                axes.text(0.5, 0.5, "defined in no child", ha="center", va="center", transform=axes.transAxes)
        figure.supylabel("density" if curve == "density" else "cumulative density")
        # A file without a date: the same run gives the same bytes.
        metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
        figure.savefig(path, dpi=200, metadata=metadata)
        plt.close(figure)
    return path
