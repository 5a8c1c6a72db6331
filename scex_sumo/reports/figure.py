"""Figure of a run: densities or cumulative densities of its metrics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.files import writing
from scex_sumo.metrics.registry import COLLISION, metric_of, side_of
from scex_sumo.reports.drawing import sheet
from scex_sumo.reports.page.charts import value_range
from scex_sumo.reports.run_table import counted
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Density

_CURVE, _CRITICAL, _RECORDED, _LIKELY = "#1f4e79", "#c0392b", "#222222", "#2e8b57"
_PANEL_IN = (2.9, 2.3)
_ACROSS = 4
_LABEL_SHARE = 0.11  # width of a label, in panel widths


def draw_figure(run: Run, curve: str, path: Path, *, metric: str | None = None) -> Path:
    """Draw a figure and return its path.

    Args:
        curve: ``density`` or ``cumulative``.
        path: SVG, PNG or PDF file.
        metric: one column; None draws all, with a headline and a legend.
    """
    columns = run.columns if metric is None else [run.column(metric)]
    if columns == [COLLISION]:
        raise UsageError(
            "--metric collision: is 0 or 1 in each future and has no density; give another metric"
        )
    samples = [run.samples(column) for column in columns]
    across = min(_ACROSS, len(columns))
    panel = _density_panel if curve == "density" else _cumulative_panel
    with sheet(_PANEL_IN[0] * across, _PANEL_IN[1] * -(-len(columns) // across)) as figure:
        panels = _metric_panels(figure, columns, across)
        for (axes, column), values in zip(panels, samples, strict=True):
            if not np.isfinite(values).any():
                axes.text(
                    0.5, 0.5, "defined in no future", ha="center", va="center", transform=axes.transAxes
                )
                axes.set_yticks([])
                continue
            panel(run, column, axes)
            if len(values) < run.children:
                axes.set_xlabel(f"{axes.get_xlabel()}; defined in {len(values)}/{run.children}")
        if len(columns) > 1:
            _explain_lines(run, figure)
        for axes in figure.axes:
            spec = axes.get_subplotspec()
            if spec is not None and spec.is_first_col():
                axes.set_ylabel("density" if curve == "density" else "cumulative density")
        # A file without a date: the same run gives the same bytes.
        metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(path.suffix)
        with writing(path):
            figure.savefig(path, dpi=200, metadata=metadata)
    return path


def _metric_panels(figure: Figure, columns: Sequence[str], across: int) -> list[tuple[Axes, str]]:
    grid = figure.subplots(max(-(-len(columns) // across), 1), across, squeeze=False)
    for axes in grid.flat[len(columns) :]:
        axes.set_axis_off()
    panels = list(zip(grid.flat, columns, strict=False))
    for axes, column in panels:
        metric = metric_of(column)
        what = "mean of scenes" if column.endswith("_mean") else metric.critical
        axes.set_title(f"{metric.words}: {what}", loc="left")
        axes.set_xlabel(metric.titled("–"))
    return panels


def _explain_lines(run: Run, figure: Figure) -> None:
    scene = run.info["seed_scene"]
    counts = f"{counted(scene['vehicles'], 'vehicle')}, {counted(run.children, 'future')}"
    figure.suptitle(f"{scene['name']}   {counts}", x=0.01, ha="left", fontsize=10)
    lines = [Line2D([], [], color=_CRITICAL, linewidth=1.0, label="threshold, critical side shaded")]
    if run.recorded is not None:
        lines.append(Line2D([], [], color=_RECORDED, linewidth=1.2, linestyle="--", label="recorded future"))
    figure.legend(handles=lines, loc="outside lower center", ncols=len(lines), frameon=False)


def _density_panel(run: Run, column: str, axes: Axes) -> None:
    curve = run.density(column)
    _fill(axes, curve.x, np.zeros_like(curve.x), curve.pdf, curve.pdf)
    if run.reference is not None and len(run.reference.samples(column)):
        likely = run.reference.density(column)
        axes.plot(likely.x, likely.pdf, color=_LIKELY, linewidth=1.2)
        _write(axes, 0.95, "likely", _LIKELY)
    axes.set_ylim(0, 1.05 * max((float(np.max(line.get_ydata())) for line in axes.lines), default=0) or 1)
    _mark(run, column, axes, curve.x)
    _draw_atoms(curve, axes)


def _cumulative_panel(run: Run, column: str, axes: Axes) -> None:
    curve = run.density(column)
    _fill(axes, curve.x, *curve.band, curve.cdf)
    axes.set_ylim(0, 1)
    _mark(run, column, axes, curve.x)


def _fill(axes: Axes, x: FloatArray, low: FloatArray, high: FloatArray, line: FloatArray) -> None:
    axes.fill_between(x, low, high, color=_CURVE, alpha=0.18, linewidth=0)
    axes.plot(x, line, color=_CURVE, linewidth=1.2)


def _write(axes: Axes, height: float, words: str, color: str = "#666666") -> None:
    place = "top" if height > 0.5 else "baseline"
    ground: dict[str, Any] = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 1}
    style: dict[str, Any] = {"ha": "right", "va": place, "bbox": ground, "zorder": 5, "fontsize": 7}
    axes.text(0.98, height, words, transform=axes.transAxes, color=color, **style)


def _draw_atoms(curve: Density, axes: Axes) -> None:
    """Draw values that many futures share as stems; label the largest where there is room."""
    (left, right), most = axes.get_xlim(), max((atom.share for atom in curve.atoms), default=1.0)
    transform = axes.get_xaxis_transform()  # heights in shares of the panel
    labelled: list[float] = []
    inside = [atom for atom in curve.atoms if left <= atom.value <= right]
    for atom in sorted(inside, key=lambda atom: -atom.share):
        height = 0.85 * atom.share / most
        axes.plot([atom.value] * 2, [0, height], color=_CURVE, linewidth=2, transform=transform)
        if all(abs(atom.value - x) > _LABEL_SHARE * (right - left) for x in labelled):
            labelled.append(atom.value)
            style: dict[str, Any] = {"size": 6, "color": _CURVE, "ha": "center", "transform": transform}
            axes.text(atom.value, height + 0.01, f"{atom.share:.0%}", **style)


def _mark(run: Run, column: str, axes: Axes, x: FloatArray) -> None:
    """Draw threshold and recorded value as vertical lines; keep the view where most futures are."""
    recorded, threshold = run.recorded_value(column), run.thresholds.get(column)
    samples, limits = run.samples(column), (float(x[0]), float(x[-1]))
    left, right = value_range(samples, recorded, threshold, limits=limits)
    if recorded is not None and left <= recorded <= right:
        axes.axvline(recorded, color=_RECORDED, linewidth=1.2, linestyle="--")
    elif recorded is not None:
        words = f"recorded {recorded:.3g} →" if recorded > right else f"← recorded {recorded:.3g}"
        _write(axes, 0.15, words, _RECORDED)
    if threshold is not None:
        if left < threshold < right:
            axes.axvline(threshold, color=_CRITICAL, linewidth=1)
        critical = (left, threshold) if side_of(column) == "left" else (threshold, right)
        low, high = max(critical[0], left), min(critical[1], right)
        if low < high:
            axes.axvspan(low, high, color=_CRITICAL, alpha=0.07, linewidth=0)
        axes.set_title(f"P = {run.p_critical(column).value:.1%}", loc="right", color=_CRITICAL)
    beyond = float(np.mean(samples > right))
    if beyond > 0:
        _write(axes, 0.04, f"{max(beyond, 0.001):.1%} beyond →")
    axes.set_xlim(left, right)
