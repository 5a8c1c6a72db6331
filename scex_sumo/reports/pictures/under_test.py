"""Picture of vehicles under test: how their own encounters are distributed, with their models and without.

Cumulative, since a vehicle's own pairs are few and many children share their values exactly.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from scex_sumo.metrics.registry import COLLISION, critical_columns
from scex_sumo.reports.pictures import sheet
from scex_sumo.results.run import Run
from scex_sumo.results.under_test import Driven, UnderTest

_WIDE = 3  # panels side by side
_COLORS: dict[Driven, str] = {"under_test": "#c0392b", "baseline": "#1f4e79"}
_NAMES: dict[Driven, str] = {"under_test": "under test", "baseline": "baseline: the same children without it"}


def draw_under_test(run: Run, stem: Path) -> list[Path]:
    """Write the cumulative densities of the metrics, with and without the models under test, as SVG and PNG.

    Args:
        run: a finished run with vehicles under test and a baseline.
        stem: path without ending.
    """
    tested = run.under_test
    columns = [c for c in critical_columns(tested.columns) if c != COLLISION]
    with sheet.sheet(9.0, 1.0 + 2.0 * -(-len(columns) // _WIDE)) as figure:
        for axes, column in sheet.metric_panels(figure, columns, wide=_WIDE):
            _panel(axes, tested, column, run.thresholds.get(column))
        sheet.left_label(figure, "cumulative density")
        sheet.headline(figure, f"{run.info['seed_scene']['name']}   {tested.label}")
        lines = [(_NAMES[driven], {"color": color, "linewidth": 1.4}) for driven, color in _COLORS.items()]
        sheet.legend(figure, lines, loc="outside lower left")
        return sheet.save(figure, stem)


def _panel(axes: Axes, tested: UnderTest, column: str, threshold: float | None) -> None:
    """Both cumulative densities of a metric with their bands, its threshold, and both critical shares."""
    samples = {driven: tested.samples(column, driven) for driven in _COLORS}
    finite = np.concatenate([values[np.isfinite(values)] for values in samples.values()])
    if not len(finite):
        sheet.empty(axes)
        return
    left, right = sheet.span(finite, float(finite.min()) - 0.4, float(finite.max()) + 0.4, (threshold,))
    for height, (driven, color) in zip((0.3, 0.18), _COLORS.items(), strict=True):
        if not np.isfinite(samples[driven]).any():
            continue
        curve = tested.density(column, driven)
        sheet.filled(axes, curve.x, *curve.band, curve.cdf, color)
        share = tested.p_critical(column, driven)
        if share is not None:
            sheet.note(axes, height, f"P = {share.value:.1%}", color)
    if threshold is not None and left < threshold < right:
        axes.axvline(threshold, color="#444444", linewidth=0.9, linestyle=":")
    axes.set_xlim(left, right)
    axes.set_ylim(0, 1)
