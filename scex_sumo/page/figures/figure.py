"""Figure of a run: densities or cumulative densities of its metrics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.registry import COLLISION, critical_columns, metric_of, side_of
from scex_sumo.page.figures.charts import samples_of_both, value_range
from scex_sumo.page.figures.drawing import STYLE, save
from scex_sumo.reports.run_table import counted
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Density

_CURVE, _CRITICAL, _RECORDED, _LIKELY = "#0072b2", "#c44e00", "#1b222b", "#9a4d86"  # as on the page
_COLUMN_IN = 85 / 25.4  # width of a column of a paper
_ONE_IN, _PANEL_IN, _HEAD_IN = 55 / 25.4, 35 / 25.4, 12 / 25.4  # heights
_ACROSS = 2
_EDGE = 0.01  # room for a stem at the left end, in panel widths
_LABEL_SHARE, _LABELS = 0.14, 4  # width of a label, in panel widths; labels of a panel
_SMALL: dict[Any, Any] = {"font.size": 6, "axes.titlesize": 6.5, "axes.linewidth": 0.6}


def draw_figure(
    run: Run, curve: str, path: str | Path | None, *, metric: str | None = None, ax: Axes | None = None
) -> list[Axes]:
    """Draw a figure of a paper's column width (85 mm) and return its panels.

    Args:
        curve: ``density`` or ``cumulative``.
        path: SVG, PNG or PDF file; None writes none.
        metric: one column; None draws the most critical values of all metrics that are defined.
        ax: draw one metric here.

    Raises:
        UsageError: the metric has no density, or is defined in no future.
    """
    columns = critical_columns(run.columns) if metric is None else [run.column(metric)]
    if columns == [COLLISION]:
        raise UsageError(
            "--metric collision: is 0 or 1 in each future and has no density; give another metric"
        )
    columns = [column for column in columns if np.isfinite(run.samples(column)).any()]
    if not columns:
        raise UsageError(f"{metric or 'metrics'}: defined in no future, so nothing can be drawn")
    if ax is not None:
        if len(columns) != 1:
            raise UsageError("plot: axes hold one metric; name it with metric=")
        _draw_panel(run, curve, columns[0], ax)
        return [ax]
    one, rows = len(columns) == 1, -(-len(columns) // _ACROSS)
    with mpl.rc_context(STYLE | _SMALL):
        size = _COLUMN_IN, _ONE_IN if one else _HEAD_IN + _PANEL_IN * rows
        figure = _figure(size, on_screen=path is None)
        grid = figure.subplots(rows, 1 if one else _ACROSS, squeeze=False)
        for axes in grid.flat[len(columns) :]:
            axes.remove()
        panels = list(grid.flat[: len(columns)])
        for axes, column in zip(panels, columns, strict=True):
            _draw_panel(run, curve, column, axes)
        _explain_lines(run, figure, headline=not one)
        if path is not None:
            # A file without a date: the same run gives the same bytes.
            metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(Path(path).suffix)
            save(figure, path, dpi=300, metadata=metadata)
    return panels


def _figure(size: tuple[float, float], *, on_screen: bool) -> Figure:
    if not on_screen:
        return Figure(figsize=size, layout="constrained")
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained", dpi=200)


def _draw_panel(run: Run, curve: str, column: str, axes: Axes) -> None:
    metric, defined = metric_of(column), len(run.samples(column))
    mean = ", mean of scenes" if column.endswith("_mean") else ""
    axes.set_title(metric.words + mean, loc="left")
    part = f", in {defined} of {run.futures}" if defined < run.futures else ""
    unit = f"[{metric.column_unit}]" if metric.column_unit else "[–]"
    axes.set_xlabel(unit + part)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    _draw_curves(run, curve, column, axes)
    spec = axes.get_subplotspec()
    if spec is None or spec.is_first_col():
        axes.set_ylabel("density" if curve == "density" else "cumulative density")


def _explain_lines(run: Run, figure: Figure, *, headline: bool) -> None:
    scene = run.info["seed_scene"]
    if headline:
        counts = f"{counted(scene['vehicles'], 'vehicle')}, {counted(run.futures, 'future')}"
        figure.suptitle(f"{scene['name']}   {counts}", x=0.01, ha="left", fontsize=7)
    lines = [Line2D([], [], color=_CURVE, linewidth=1.2, label="stress test")]
    if run.reference is not None:
        lines.append(Line2D([], [], color=_LIKELY, linewidth=1.2, label="human-like"))
    if run.horizons_s:
        words = f"by {', '.join(f'{t:g}' for t in run.horizons_s)} s"
        lines.append(Line2D([], [], color=_CURVE, linewidth=0.7, linestyle=":", label=words))
    lines.append(Line2D([], [], color=_CRITICAL, linewidth=1.0, label="threshold"))
    if run.recorded is not None:
        lines.append(Line2D([], [], color=_RECORDED, linewidth=1.2, linestyle="--", label="recorded"))
    style: dict[str, Any] = {"columnspacing": 1.0, "handlelength": 1.4, "frameon": False}
    figure.legend(handles=lines, loc="outside lower center", ncols=min(len(lines), 4), **style)


def _draw_curves(run: Run, curve: str, column: str, axes: Axes) -> None:
    drawn, ends = run.density(column), [run.density(column).x]
    drawn.plot(axes, curve=curve, color=_CURVE)
    for until_s in run.horizons_s:
        if not np.isnan(run.values(column, until_s=until_s)).all():
            early = run.density(column, until_s=until_s)
            y, alpha = early.pdf if curve == "density" else early.cdf, until_s / run.horizons_s[-1]
            axes.plot(early.x, y, color=_CURVE, linewidth=0.7, linestyle=":", alpha=0.4 + 0.6 * alpha)
    if run.reference is not None and len(run.reference.samples(column)):
        likely = run.reference.density(column)
        y = likely.pdf if curve == "density" else likely.cdf
        axes.plot(likely.x, y, color=_LIKELY, linewidth=1.2)
        ends.append(likely.x)
    if curve == "density":
        most = max((float(np.max(line.get_ydata())) for line in axes.lines), default=0)
        axes.set_ylim(0, 1.05 * most or 1)
    _mark(run, column, axes, np.concatenate(ends))
    if curve == "density":
        _draw_atoms(drawn, axes)


def _write(axes: Axes, height: float, words: str, color: str = "#666666") -> None:
    place = "top" if height > 0.5 else "baseline"
    ground: dict[str, Any] = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 1}
    style: dict[str, Any] = {"ha": "right", "va": place, "bbox": ground, "zorder": 5, "fontsize": 5.5}
    axes.text(0.98, height, words, transform=axes.transAxes, color=color, **style)


def _draw_atoms(curve: Density, axes: Axes) -> None:
    """Draw values that many futures share as stems; label the largest where there is room."""
    (left, right), most = axes.get_xlim(), max((atom.share for atom in curve.atoms), default=1.0)
    transform = axes.get_xaxis_transform()  # heights in shares of the panel
    drawn = [np.asarray(line.get_xdata()) for line in axes.lines]
    labelled = [float(x[0]) for x in drawn if len(x) == 2]
    lines = len(labelled)  # threshold and recorded value; a share of most futures is told also beside these
    inside = [atom for atom in curve.atoms if left <= atom.value <= right]
    for atom in sorted(inside, key=lambda atom: -atom.share):
        height = 0.85 * atom.share / most
        axes.plot([atom.value] * 2, [0, height], color=_CURVE, linewidth=2, transform=transform)
        apart = (abs(atom.value - x) / (right - left) for x in labelled)
        is_free = all(share > _LABEL_SHARE for share in apart)
        if len(labelled) < lines + _LABELS and (is_free or atom.share > 0.5):
            labelled.append(atom.value)
            style: dict[str, Any] = {"size": 5, "color": _CURVE, "ha": "center", "transform": transform}
            style |= {"path_effects": [withStroke(linewidth=1.2, foreground="white")], "zorder": 6}
            if atom.value - left < _LABEL_SHARE / 2 * (right - left):
                style["ha"] = "left"  # not over the axis
            axes.text(atom.value, height + 0.01, f"{atom.share:.0%}", **style)


def _mark(run: Run, column: str, axes: Axes, x: FloatArray) -> None:
    """Draw threshold and recorded value as vertical lines; keep the view where most futures are."""
    recorded, threshold = run.recorded_value(column), run.thresholds.get(column)
    samples, limits = run.samples(column), (float(x.min()), float(x.max()))
    left, right = value_range(samples_of_both(run, column), recorded, threshold, limits=limits)
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
    axes.set_xlim(left - _EDGE * (right - left), right)
