"""Sheet of a picture: style, figure, panels of metrics, files; matplotlib's backend stays the user's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scex_sumo.arrays import FloatArray
from scex_sumo.files import writing
from scex_sumo.metrics.registry import metric_of
from scex_sumo.reports.tables.runs import counted
from scex_sumo.results.run import Run

STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",  # text stays text: searchable, and editable for a paper
    "svg.hashsalt": "scex-sumo",  # the same picture has the same bytes
    "figure.dpi": 100,
}


@contextmanager
def sheet(width_in: float, height_in: float) -> Iterator[Figure]:
    """An empty figure in the house's style; draw and save it inside."""
    with mpl.rc_context(STYLE):
        yield Figure(figsize=(width_in, height_in), layout="constrained")


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write a figure as SVG and PNG; returns the paths."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    files = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    with writing(stem.parent):
        figure.savefig(files[0], metadata={"Date": None})
        figure.savefig(files[1], dpi=150)
    return files


def metric_panels(
    figure: Figure, columns: Sequence[str], *, wide: int = 4, labelled: bool = True, shared: bool = False
) -> list[tuple[Axes, str]]:
    """A panel for each metric column with its title and, where labelled, its unit; ``wide`` side by side."""
    grid = figure.subplots(
        max(-(-len(columns) // wide), 1), wide, sharex=shared, sharey=shared, squeeze=False
    )
    for axes in grid.flat[len(columns) :]:
        axes.set_axis_off()
    panels = list(zip(grid.flat, columns, strict=False))
    for axes, column in panels:
        metric = metric_of(column)
        what = "mean of scenes" if column.endswith("_mean") else metric.critical
        axes.set_title(f"{metric.words}: {what}", loc="left")
        if labelled:
            axes.set_xlabel(metric.titled("–"))
    return panels


def left_label(figure: Figure, text: str) -> None:
    """Label the y axes of the panels that stand leftmost."""
    for axes in figure.axes:
        spec = axes.get_subplotspec()
        if spec is not None and spec.is_first_col():
            axes.set_ylabel(text)


def empty(axes: Axes, words: str = "defined in no child") -> None:
    """Say in a panel why nothing is drawn there."""
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes)
    axes.set_yticks([])


def note(axes: Axes, height: float, words: str, color: str = "#666666", **more: Any) -> None:
    """Words at the right edge of a panel; height from 0 (bottom) to 1."""
    place = "top" if height > 0.5 else "baseline"
    ground: dict[str, Any] = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 1}
    style: dict[str, Any] = {"ha": "right", "va": place, "bbox": ground, "zorder": 5} | more
    axes.text(0.98, height, words, transform=axes.transAxes, color=color, **style)


def filled(
    axes: Axes, x: FloatArray, low: FloatArray, high: FloatArray, line: FloatArray, color: str
) -> None:
    """A curve over its shaded area or band."""
    axes.fill_between(x, low, high, color=color, alpha=0.18, linewidth=0)
    axes.plot(x, line, color=color, linewidth=1.2)


def span(values: FloatArray, low: float, high: float, marks: Sequence[float | None]) -> tuple[float, float]:
    """Range of an x axis: values without a far tail, within ``low`` and ``high``, and marks that are near."""
    first, third = np.quantile(values[np.isfinite(values)], [0.25, 0.75])
    spread = max(float(third - first), 0.25)
    left, right = max(low, first - 5 * spread), min(high, third + 5 * spread)
    for mark in marks:
        margin = 0.5 * (right - left)
        if mark is not None and left - margin <= mark <= right + margin:
            left, right = min(left, mark - 0.1), max(right, mark + 0.1)
    return float(left), float(right)


def headline(figure: Figure, text: str) -> None:
    """The title above all panels, at the left."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=10)


def run_name(run: Run, *, children: bool = False) -> str:
    """The name of a run's seed scene, its vehicles and, if wanted, its children."""
    scene = run.info["seed_scene"]
    words = f"{scene['name']}   {counted(scene['vehicles'], 'vehicle')}"
    return f"{words}, {counted(run.children, 'child scenario')}" if children else words


def legend(figure: Figure, entries: Sequence[tuple[str, dict[str, Any]]], **place: Any) -> None:
    """A legend of lines, each a label with the line's properties, in one row."""
    lines = [Line2D([], [], **style) for _, style in entries]
    labels = [label for label, _ in entries]
    options: dict[str, Any] = {"loc": "outside upper right", "ncols": len(labels), "frameon": False} | place
    figure.legend(lines, labels, **options)
