"""Pictures of a comparison: the tree of the runs with their distances, and their densities side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.registry import metric_of
from scex_sumo.reports.pictures import sheet
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import BANDWIDTH, density
from scex_sumo.statistics.distances import Scale
from scex_sumo.statistics.grouping import Grouping
from scex_sumo.studies.compare import Comparison

_COLORS = ("#1f77b4", "#d95f02", "#2a9d5c", "#8e44ad", "#b8860b", "#c2185b", "#00838f", "#6d4c41")
_JOINING, _BRANCH, _THRESHOLD, _TEXT = "#b0b0b0", "#333333", "#c0392b", "#444444"
_TICKS = (0, 0.05, 0.2, 0.5, 1, 2, 4, 8, 16)  # of the tree, far enough apart on its axis
_LARGE_ROWS_UP_TO = 30
_NUMBERS_UP_TO = 14  # runs whose distances are written into the heat map
_FINEST = 1 / 60  # of the axis: a bandwidth below this is a comb, not a curve


def draw_dendrogram(
    comparison: Comparison,
    grouping: Grouping,
    stem: Path,
    *,
    kinds: Sequence[str] | None = None,
    title: str | None = None,
) -> list[Path]:
    """Write the tree of the runs beside the matrix of their distances as SVG and PNG.

    Args:
        stem: path without ending.
        kinds: (R,) what is known of the runs, which then colours their names; else their group does.
    """
    count = len(comparison.labels)
    row_height, font = (0.24, 8.0) if count <= _LARGE_ROWS_UP_TO else (0.15, 6.0)
    height = max(2.2, row_height * count) + 1.3
    with sheet.sheet(5.6 + height, height) as figure:
        tree, map_ = figure.subplots(1, 2, width_ratios=(3.4, height))
        _draw_tree(tree, comparison, grouping, colored=kinds is None)
        _draw_matrix(figure, map_, comparison, grouping, kinds)
        map_.tick_params(labelsize=font)
        fit = float(grouping.silhouette.mean())
        plain = f"Which of {count} seed scenes are alike: {grouping.groups} groups, silhouette {fit:.2f}"
        colors = "colour of a name: what is known of it" if kinds is not None else "one colour: one group"
        reading = f"yellow: alike, dark: far apart; {colors}; grey: what chance alone makes"
        figure.suptitle(f"{title or plain}\n{reading}", x=0.01, ha="left", fontsize=9)
        _kind_legend(figure, kinds)
        return sheet.save(figure, stem)


def _draw_tree(axes: Axes, comparison: Comparison, grouping: Grouping, *, colored: bool) -> None:
    """Leaves at the right, in the rows of the heat map; branches within a group dark or in its colour."""

    def color_of(number: int) -> str:
        return _JOINING if number == 0 else group_color(number) if colored else _BRANCH

    count = len(comparison.labels)
    place = {int(run): float(row) for row, run in enumerate(grouping.order)}
    height = dict.fromkeys(place, 0.0)
    group: dict[int, int] = {run: int(grouping.group[run]) for run in place}
    for step, (one, two, at, _) in enumerate(grouping.linkage):
        parts, joined = (int(one), int(two)), count + step
        same = group[parts[0]] if group[parts[0]] == group[parts[1]] else 0
        for part in parts:
            axes.plot([height[part], at], [place[part]] * 2, color=color_of(group[part]), linewidth=1.3)
        axes.plot([at, at], [place[p] for p in parts], color=color_of(same), linewidth=1.3)
        place[joined] = (place[parts[0]] + place[parts[1]]) / 2
        height[joined], group[joined] = float(at), same
    noise = float(np.nanmedian(comparison.noise)) if not np.isnan(comparison.noise).all() else 0.0
    if noise > 0:
        axes.axvspan(0, noise, color="#000000", alpha=0.08, linewidth=0)
        axes.text(noise, -0.62, "by chance ", fontsize=6.5, color=_TEXT, ha="center", va="bottom")
    top = float(grouping.linkage[-1, 2])
    # Ward's heights grow with the size of the groups: the root gives the small ones room.
    axes.set_xscale("function", functions=(_root, np.square))
    right = max(top, noise) * 1.05 or 1.0
    axes.set(xlim=(right, 0), ylim=(count - 0.5, -0.5), yticks=[])
    axes.set_xticks([tick for tick in _TICKS if tick <= right], [f"{t:g}" for t in _TICKS if t <= right])
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("distance at which groups join (Ward)")


def _root(values: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(values, 0.0))


def _draw_matrix(
    figure: Figure, axes: Axes, comparison: Comparison, grouping: Grouping, kinds: Sequence[str] | None
) -> None:
    order = grouping.order
    total = comparison.total[np.ix_(order, order)]
    image = axes.imshow(total, cmap="viridis_r", vmin=0, aspect="auto", interpolation="nearest")
    _name_rows(axes, comparison, grouping, _label_colors(grouping, kinds))
    axes.set_xticks([])
    for side in axes.spines.values():
        side.set_visible(False)
    axes.tick_params(length=0)
    ends = np.flatnonzero(np.diff(grouping.group[order])) + 0.5
    for end in ends:
        axes.axhline(end, color="white", linewidth=1.5)
        axes.axvline(end, color="white", linewidth=1.5)
    if len(order) <= _NUMBERS_UP_TO:
        for (row, column), value in np.ndenumerate(total):
            if row != column:
                shade = "white" if value > 0.55 * total.max() else "#222222"
                axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=6.5, color=shade)
    unit = "1 = shifted by the middle 80 %" if comparison.kind == "w1" else "Jensen-Shannon, 0 to 1"
    bar = figure.colorbar(image, ax=axes, shrink=0.6, pad=0.02, label=f"distance ({unit})")
    bar.outline.set_visible(False)


def draw_compared_densities(
    runs: Sequence[Run],
    comparison: Comparison,
    grouping: Grouping,
    stem: Path,
    *,
    kinds: Sequence[str] | None = None,
) -> list[Path]:
    """Write the densities of all runs as SVG and PNG: a row per run, a column per metric.

    Args:
        comparison: gives every column its axis.
        grouping: gives the order of the rows.
        stem: path without ending.
        kinds: (R,) what is known of the runs; colours them in place of their groups.
    """
    colors = _label_colors(grouping, kinds)
    count, metrics = len(runs), comparison.metrics
    row_height = float(np.clip(5.0 / count, 0.26, 0.8))
    with sheet.sheet(1.5 + 1.15 * len(metrics), 1.5 + row_height * count) as figure:
        grid = figure.subplots(1, len(metrics), sharey=True)
        for axes, metric, scale in zip(grid, metrics, comparison.scales, strict=True):
            columns = [run.samples(metric) for run in runs]
            span = _view(columns, scale)
            for row, run in enumerate(grouping.order):
                share = len(columns[run]) / runs[run].children
                _ridge(axes, columns[run], share, row=row, span=span, color=colors[run])
            _finish_column(axes, metric, span, runs[0].thresholds)
        grid[0].set_ylim(count - 0.85, -1.0)
        _name_rows(grid[0], comparison, grouping, colors)
        figure.suptitle(_READING, x=0.01, ha="left", fontsize=8.5)
        _kind_legend(figure, kinds)
        return sheet.save(figure, stem)


_READING = (
    "Densities of seed scenes: how often (height) each metric value (x) occurs among the child scenarios. "
    "Rows: seed scenes, alike ones side by side.\n"
    "Tick: median. Red line: threshold, critical to its left (tq, ttc: to its right). Curves are scaled to "
    "one height, or to the share of children in which the metric is defined (printed)."
)


def _ridge(
    axes: Axes, samples: FloatArray, share: float, *, row: int, span: tuple[float, float], color: str
) -> None:
    axes.axhline(row, color="#dddddd", linewidth=0.5, zorder=1)
    left, right = span
    if share < 1:
        axes.text(right, row - 0.5, f"{share:.0%}", ha="right", va="bottom", fontsize=5.5, color=_TEXT)
    finite = samples[np.isfinite(samples)]
    if finite.size == 0:
        return
    x = np.linspace(left, right, 240)
    height = density(samples, max(BANDWIDTH, _FINEST * (right - left)), x=x).pdf
    if height.max() <= 0:
        return
    height *= 0.85 * share / height.max()
    axes.fill_between(x, row, row - height, color=color, alpha=0.35, linewidth=0, zorder=2)
    axes.plot(x, row - height, color=color, linewidth=0.8, zorder=3)
    middle = float(np.median(samples))
    if left <= middle <= right:
        at = float(np.interp(middle, x, height))
        axes.plot([middle, middle], [row, row - at], color=color, linewidth=1.1, zorder=3)


def _view(columns: Sequence[FloatArray], scale: Scale) -> tuple[float, float]:
    """Where the values lie, cut at the fences of the distance."""
    finite = np.concatenate([c[np.isfinite(c)] for c in columns])
    if finite.size == 0:
        return 0.0, 1.0
    left, right = max(float(finite.min()), scale.low), min(float(finite.max()), scale.high)
    margin = max(0.04 * (right - left), 2 * BANDWIDTH)
    return left - margin, right + margin


def _finish_column(
    axes: Axes, metric: str, span: tuple[float, float], thresholds: Mapping[str, float]
) -> None:
    axes.set_xlim(span)
    known = metric_of(metric)
    axes.set_xlabel(known.titled("–"))
    axes.set_title(f"{known.name}\n{'mean' if metric.endswith('_mean') else known.critical}", fontsize=8)
    threshold = thresholds.get(metric)
    if threshold is not None and span[0] <= threshold <= span[1]:
        axes.axvline(threshold, color=_THRESHOLD, linewidth=0.8, zorder=0)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)


def group_color(group: int) -> str:
    """Colour of a group, numbered from 1."""
    return _COLORS[(group - 1) % len(_COLORS)]


def _label_colors(grouping: Grouping, kinds: Sequence[str] | None) -> list[str]:
    if kinds is None:
        return [group_color(int(g)) for g in grouping.group]
    names = sorted(set(kinds))
    return [group_color(names.index(kind) + 1) for kind in kinds]


def _name_rows(axes: Axes, comparison: Comparison, grouping: Grouping, colors: Sequence[str]) -> None:
    """Names of the runs beside the rows, in their colours."""
    axes.set_yticks(range(len(grouping.order)), [comparison.labels[r] for r in grouping.order])
    for tick, run in zip(axes.get_yticklabels(), grouping.order, strict=True):
        tick.set_color(colors[run])


def _kind_legend(figure: Figure, kinds: Sequence[str] | None) -> None:
    names = sorted(set(kinds or ()))
    lines = [(name, {"color": group_color(n + 1), "linewidth": 4}) for n, name in enumerate(names)]
    if lines:
        sheet.legend(figure, lines, loc="outside lower left")
