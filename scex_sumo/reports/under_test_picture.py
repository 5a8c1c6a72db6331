"""Picture of vehicles under test: the densities of their own encounters, with their models and without."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.registry import most_critical
from scex_sumo.reports.run_pictures import STYLE, axis_label, panel_grid, panel_title, save
from scex_sumo.results.run import Run
from scex_sumo.results.under_test import Driven, UnderTest

_COLORS: dict[Driven, str] = {"under_test": "#c0392b", "baseline": "#1f4e79"}
_NAMES: dict[Driven, str] = {"under_test": "under test", "baseline": "baseline: the same children without it"}


def draw_under_test(run: Run, stem: Path) -> list[Path]:
    """Write the densities of the metrics with and without the models under test as SVG and PNG.

    Args:
        run: a finished run with vehicles under test and a baseline.
        stem: path without ending.
    """
    tested = run.under_test
    with plt.rc_context(STYLE):
        columns = most_critical(tested.columns)
        figure, grid = panel_grid(len(columns), across=3, size=(3.0, 2.5))
        for axes, column in zip(grid.flat, columns, strict=False):
            axes.set_title(panel_title(column), loc="left")
            axes.set_xlabel(axis_label(column))
            _panel(axes, tested, column, run.thresholds.get(column))
        for axes in grid[:, 0]:
            axes.set_ylabel("density")
        name = run.info["seed_scene"]["name"]
        figure.suptitle(f"{name}   {tested.label}", x=0.01, ha="left", fontsize=10)
        handles = [Line2D([], [], color=_COLORS[d], linewidth=1.4) for d in _COLORS]
        figure.legend(handles, list(_NAMES.values()), loc="outside lower left", ncols=2, frameon=False)
    return save(figure, stem)


def _panel(axes: Axes, tested: UnderTest, column: str, threshold: float | None) -> None:
    """Both densities of a metric, its threshold, and both critical shares."""
    samples = {driven: tested.samples(column, driven) for driven in _COLORS}
    finite = np.concatenate([values[np.isfinite(values)] for values in samples.values()])
    if not len(finite):
        axes.text(0.5, 0.5, "defined in no child", ha="center", va="center", transform=axes.transAxes)
        axes.set_yticks([])
        return
    left, right = _view(finite, threshold)
    for height, (driven, color) in zip((0.95, 0.86), _COLORS.items(), strict=True):
        if not np.isfinite(samples[driven]).any():
            continue
        curve = tested.density(column, driven)
        axes.fill_between(curve.x, curve.pdf, color=color, alpha=0.15, linewidth=0)
        axes.plot(curve.x, curve.pdf, color=color, linewidth=1.4)
        share = tested.p_critical(column, driven)
        if share is not None:
            words = f"P = {share.value:.1%}"
            axes.text(0.98, height, words, ha="right", va="top", transform=axes.transAxes, color=color)
    if threshold is not None and left < threshold < right:
        axes.axvline(threshold, color="#444444", linewidth=0.9, linestyle=":")
    axes.set_xlim(left, right)
    axes.set_ylim(bottom=0)


def _view(finite: FloatArray, threshold: float | None) -> tuple[float, float]:
    """Range of the x axis: all but a far tail, with the threshold where it is near."""
    first, third = np.quantile(finite, [0.25, 0.75])
    spread = max(float(third - first), 0.25)
    left = max(float(finite.min()) - 0.4, float(first) - 4 * spread)
    right = min(float(finite.max()) + 0.4, float(third) + 4 * spread)
    margin = 0.5 * (right - left)
    if threshold is not None and left - margin <= threshold <= right + margin:
        left, right = min(left, threshold - 0.1), max(right, threshold + 0.1)
    return left, right
