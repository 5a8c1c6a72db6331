"""Figure of a run for a paper: the density or cumulative curve of one metric, or of all."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.reports.pictures import sheet
from scex_sumo.reports.pictures.runs import cumulative_panel, density_panel
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
    samples = [run.samples(column) for column in columns]  # says which metrics there are
    across = min(_ACROSS, len(columns))
    panel = density_panel if curve == "density" else cumulative_panel
    with sheet.sheet(_PANEL_IN[0] * across, _PANEL_IN[1] * -(-len(columns) // across)) as figure:
        panels = sheet.metric_panels(figure, columns, wide=across)
        for (axes, column), values in zip(panels, samples, strict=True):
            if np.isfinite(values).any():
                panel(run, column, axes)
            else:
                sheet.empty(axes)
        sheet.left_label(figure, "density" if curve == "density" else "cumulative density")
        # A file without a date: the same run gives the same bytes.
        metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
        figure.savefig(path, dpi=200, metadata=metadata)
    return path
