"""Figure of one run or of several on common axes: densities or cumulative densities of their metrics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.registry import COLLISION, critical_columns
from scex_sumo.page.figures.axes import samples_of_both, value_range
from scex_sumo.page.figures.drawing import STYLE, save
from scex_sumo.reports.words import counted
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Density, density

_CURVE, _CRITICAL, _RECORDED, _LIKELY = "#0072b2", "#c44e00", "#1b222b", "#9a4d86"  # as on the page
COLORS: Final = (_CURVE, "#009e73", "#e69f00", "#cc79a7", "#56b4e9", "#000000", "#8b6b3d", "#999999")
"""Of several runs: most are those of Okabe and Ito 2008, which also colour-blind readers tell apart."""
_COLUMN_IN = 85 / 25.4  # width of a column of a paper
_ONE_IN, _PANEL_IN, _HEAD_IN = 55 / 25.4, 35 / 25.4, 12 / 25.4  # heights
_LINE_IN, _LETTERS = 3 / 25.4, 78  # height of a line of the legend; letters that fit into it
_ACROSS = 2
_EDGE = 0.01  # room for a stem at the left end, in panel widths
_LABEL_SHARE, _LABELS = 0.14, 4  # width of a label, in panel widths; labels of a panel
_SMALL: dict[Any, Any] = {"font.size": 6, "axes.titlesize": 6.5, "axes.linewidth": 0.6}


@checked
def plot(
    runs: Run | Sequence[Run],
    path: str | Path | None = None,
    *,
    metric: str | None = None,
    curve: str = "density",
    labels: Sequence[str] | None = None,
    ax: Any = None,
) -> list[Axes]:
    """Draw densities of one or several runs on common axes, in a figure of a paper's column width (85 mm).

    One run is drawn with its human-like futures and its times before the end, several as stress tests alone.

    Args:
        runs: at most as many as there are `COLORS`.
        path: SVG, PNG or PDF file to write.
        metric: one column; None draws the most critical values of all metrics that some run defines.
        curve: ``density`` or ``cumulative``.
        labels: of the runs, in the legend; None: the names of their folders.
        ax: matplotlib's axes for one metric; None makes a figure, of pyplot without a ``path``.

    Returns:
        The axes.

    Raises:
        UsageError: the metric has no density, or is defined in no future; too many runs, or labels of others.

    Example:
        >>> (axes,) = scex.plot(run, "ttc.svg", metric="ttc")
        >>> axes.get_title(loc="left")
        '1/TTC'
    """
    runs = [runs] if isinstance(runs, Run) else list(runs)
    labels = labels or (["stress test"] if len(runs) == 1 else [run.folder.name for run in runs])
    if len(runs) > len(COLORS):
        raise UsageError(f"plot: {len(runs)} results, but a figure has {len(COLORS)} colours; give fewer")
    if not runs or len(labels) != len(runs):
        raise UsageError(f"plot: {len(runs)} results and {len(labels)} labels; give one for each result")
    columns = _columns(runs, metric)
    if ax is not None:
        if len(columns) != 1:
            raise UsageError("plot: axes hold one metric; name it with metric=")
        _draw_panel(runs, curve, columns[0], ax)
        return [ax]
    is_single, rows = len(columns) == 1, -(-len(columns) // _ACROSS)
    with mpl.rc_context(STYLE | _SMALL):
        size = _COLUMN_IN, _ONE_IN if is_single else _HEAD_IN + _PANEL_IN * rows
        if path is None:
            from matplotlib import pyplot

            figure = pyplot.figure(figsize=size, layout="constrained", dpi=200)
        else:
            figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(rows, 1 if is_single else _ACROSS, squeeze=False)
        for axes in grid.flat[len(columns) :]:
            axes.remove()
        panels = list(grid.flat[: len(columns)])
        for axes, column in zip(panels, columns, strict=True):
            _draw_panel(runs, curve, column, axes)
        if len(runs) == 1 and not is_single:
            scene, futures = runs[0].info["seed_scene"], counted(runs[0].futures, "future")
            head = f"{scene['name']}   {counted(scene['vehicles'], 'vehicle')}, {futures}"
            figure.suptitle(head, x=0.01, ha="left", fontsize=7)
        _add_legend(runs, labels, figure)
        if path is not None:
            # A file without a date: the same run gives the same bytes.
            metadata = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(Path(path).suffix)
            save(figure, path, dpi=300, metadata=metadata)
    return panels


def _columns(runs: Sequence[Run], metric: str | None) -> list[str]:
    """Return the columns that all runs have and some run defines: one, or all most critical values."""
    columns = critical_columns(runs[0].columns) if metric is None else [runs[0].column(metric)]
    if columns == [COLLISION]:
        raise UsageError(
            "--metric collision: is 0 or 1 in each future and has no density; give another metric"
        )
    columns = [column for column in columns if all(column in run.columns for run in runs)]
    columns = [column for column in columns if any(np.isfinite(run.samples(column)).any() for run in runs)]
    if not columns:
        raise UsageError(f"{metric or 'metrics'}: defined in no future, so nothing can be drawn")
    return columns


def _draw_panel(runs: Sequence[Run], curve: str, column: str, axes: Axes) -> None:
    metric, unit = runs[0].metric(column), runs[0].metric(column).column_unit
    mean = ", mean of scenes" if column.endswith("_mean") else ""
    axes.set_title(metric.words + mean, loc="left")
    axes.set_xlabel(f"[{unit or '–'}]{_defined(runs, column)}")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    if len(runs) == 1:
        _draw_alone(runs[0], curve, column, axes)
    else:
        _draw_together(runs, curve, column, axes)
    spec = axes.get_subplotspec()
    if spec is None or spec.is_first_col():
        axes.set_ylabel("density" if curve == "density" else "cumulative density")


def _defined(runs: Sequence[Run], column: str) -> str:
    """Return in how many futures a metric is defined, in words; nothing if in all."""
    counts = [len(run.samples(column)) for run in runs]
    if all(count == run.futures for count, run in zip(counts, runs, strict=True)):
        return ""
    if len(runs) == 1:
        return f", in {counts[0]} of {runs[0].futures}"
    shares = [count / run.futures for count, run in zip(counts, runs, strict=True)]
    return f", in {100 * min(shares):.0f}–{max(shares):.0%}"


def _add_legend(runs: Sequence[Run], labels: Sequence[str], figure: Figure) -> None:
    lines = [
        Line2D([], [], color=color, linewidth=1.2, label=label)
        for color, label in zip(COLORS, labels, strict=False)
    ]
    if len(runs) == 1 and runs[0].reference is not None:
        lines.append(Line2D([], [], color=_LIKELY, linewidth=1.2, label="human-like"))
    if len(runs) == 1 and runs[0].horizons_s:
        words = f"by {', '.join(f'{t:g}' for t in runs[0].horizons_s)} s"
        lines.append(Line2D([], [], color=_CURVE, linewidth=0.7, linestyle=":", label=words))
    lines.append(Line2D([], [], color=_CRITICAL, linewidth=1.0, label="threshold"))
    if any(run.recorded is not None for run in runs):
        lines.append(Line2D([], [], color=_RECORDED, linewidth=1.2, linestyle="--", label="recorded"))
    longest = max(len(str(line.get_label())) for line in lines)
    columns = max(1, min(len(lines), 4, _LETTERS // (longest + 6)))
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + _LINE_IN * (-(-len(lines) // columns) - 1))
    style: dict[str, Any] = {"columnspacing": 1.0, "handlelength": 1.4, "frameon": False}
    figure.legend(handles=lines, loc="outside lower center", ncols=columns, **style)


def _draw_alone(run: Run, curve: str, column: str, axes: Axes) -> None:
    drawn = run.density(column)
    drawn.plot(axes, curve=curve, color=_CURVE)
    for until_s in run.horizons_s:
        if not np.isnan(run.values(column, until_s=until_s)).all():
            early, alpha = run.density(column, until_s=until_s), until_s / run.horizons_s[-1]
            style: dict[str, Any] = {"linewidth": 0.7, "linestyle": ":", "alpha": 0.4 + 0.6 * alpha}
            axes.plot(early.x, _heights(early, curve), color=_CURVE, **style)
    ends = [drawn.x]
    if run.reference is not None and len(run.reference.samples(column)):
        likely = run.reference.density(column)
        axes.plot(likely.x, _heights(likely, curve), color=_LIKELY, linewidth=1.2)
        ends.append(likely.x)
    _fit_height(curve, axes)
    _mark([(run, _RECORDED)], column, axes, samples_of_both(run, column), np.concatenate(ends))
    samples, (_, right) = run.samples(column), axes.get_xlim()
    if run.thresholds.get(column) is not None:
        axes.set_title(f"P = {run.p_critical(column).value:.1%}", loc="right", color=_CRITICAL)
    beyond = float(np.mean(samples > right))
    if beyond > 0:
        _write(axes, 0.04, f"{max(beyond, 0.001):.1%} beyond →")
    if curve == "density":
        _draw_atoms(drawn, axes)


def _draw_together(runs: Sequence[Run], curve: str, column: str, axes: Axes) -> None:
    """Draw curves of several runs; densities as the paper has them, as stems would hide each other."""
    known = [(run, color) for run, color in zip(runs, COLORS, strict=False) if len(run.samples(column))]
    ends = []
    for run, color in known:
        if curve == "cumulative":
            drawn = run.density(column)
            axes.fill_between(drawn.x, *drawn.band, color=color, alpha=0.12, linewidth=0)
        else:
            samples = run.samples(column)
            drawn = density(samples, reflect=bool(samples.min() >= 0))
        axes.plot(drawn.x, _heights(drawn, curve), color=color, linewidth=1.2)
        ends.append(drawn.x)
    axes.set_ylim(0.0, 1.0)
    _fit_height(curve, axes)
    samples = np.concatenate([run.samples(column) for run, _ in known])
    _mark(known, column, axes, samples, np.concatenate(ends))


def _heights(drawn: Density, curve: str) -> FloatArray:
    return drawn.pdf if curve == "density" else drawn.cdf


def _fit_height(curve: str, axes: Axes) -> None:
    if curve == "density":
        most = max((float(np.max(line.get_ydata())) for line in axes.lines), default=0)
        axes.set_ylim(0, 1.05 * most or 1)


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


def _mark(
    known: Sequence[tuple[Run, str]], column: str, axes: Axes, samples: FloatArray, x: FloatArray
) -> None:
    """Draw threshold and recorded values as vertical lines; keep the view where most futures are."""
    run, recorded = known[0][0], [run.recorded_value(column) for run, _ in known]
    threshold = run.thresholds.get(column)
    limits = (float(x.min()), float(x.max()))
    left, right = value_range(samples, *recorded, threshold, limits=limits)
    away = 0
    for value, (_, color) in zip(recorded, known, strict=True):
        if value is not None and left <= value <= right:
            axes.axvline(value, color=color, linewidth=1.2, linestyle="--")
        elif value is not None:
            words = f"recorded {value:.3g} →" if value > right else f"← recorded {value:.3g}"
            _write(axes, 0.15 + 0.09 * away, words, color)
            away += 1
    if threshold is not None:
        if left < threshold < right:
            axes.axvline(threshold, color=_CRITICAL, linewidth=1)
        critical = (left, threshold) if run.metric(column).side == "left" else (threshold, right)
        low, high = max(critical[0], left), min(critical[1], right)
        if low < high:
            axes.axvspan(low, high, color=_CRITICAL, alpha=0.07, linewidth=0)
    axes.set_xlim(left - _EDGE * (right - left), right)
