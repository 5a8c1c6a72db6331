"""Figure of a run for a paper: the density or cumulative curve of one metric, or of all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scex_sumo.files import writing
from scex_sumo.reports.pictures import sheet
from scex_sumo.reports.pictures.runs import CRITICAL, RECORDED, cumulative_panel, density_panel
from scex_sumo.results.run import Run

_PANEL_IN = (2.9, 2.3)
_ACROSS = 4


def draw_figure(run: Run, curve: str, path: Path, *, metric: str | None = None) -> Path:
    """Draw a figure; of several metrics with a headline and a legend.

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
            if not np.isfinite(values).any():
                sheet.empty(axes)
                continue
            panel(run, column, axes)
            if len(values) < run.children:
                axes.set_xlabel(f"{axes.get_xlabel()}; defined in {len(values)}/{run.children}")
        if len(columns) > 1:
            _explain_lines(run, figure)
        sheet.left_label(figure, "density" if curve == "density" else "cumulative density")
        # A file without a date: the same run gives the same bytes.
        metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
        with writing(path):
            figure.savefig(path, dpi=200, metadata=metadata)
    return path


def _explain_lines(run: Run, figure: Figure) -> None:
    sheet.headline(figure, sheet.run_name(run, children=True))
    lines: list[tuple[str, dict[str, object]]] = [
        ("threshold, critical side shaded", {"color": CRITICAL, "linewidth": 1.0})
    ]
    if run.recorded is not None:
        lines.append(("recorded future", {"color": RECORDED, "linewidth": 1.2, "linestyle": "--"}))
    sheet.legend(figure, lines, loc="outside lower center")
