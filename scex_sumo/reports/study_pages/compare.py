"""Page of a comparison: which seed scenes are alike, and what sets them apart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.reports.page.density_plot import metric_title
from scex_sumo.reports.page.html import Html
from scex_sumo.reports.page.study import card, plots, table, table_place, write_study
from scex_sumo.reports.page.svg import Plane
from scex_sumo.reports.study_pages.tree import draw_tree
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import BANDWIDTH, density
from scex_sumo.statistics.distances import Scale
from scex_sumo.statistics.grouping import Grouping
from scex_sumo.studies.compare import Comparison

HTML = "compare.html"
_KINDS = 6
_ROW_PX = 34
_FINEST = 1 / 60
"""Of the axis: a bandwidth below this is a comb, not a curve."""


def write_comparison(runs: Sequence[Run], comparison: Comparison, grouping: Grouping, path: Path) -> Path:
    """Write the page.

    Args:
        runs: that are compared.
        comparison: their distances.
        grouping: which belong together.
        path: HTML file.
    """
    noise = float(np.nanmedian(comparison.noise)) if not np.isnan(comparison.noise).all() else float("nan")
    fit = float(grouping.silhouette.mean())
    unit = (
        "1: shifted by the range of the middle 80 % of all values"
        if comparison.kind == "w1"
        else "root of the Jensen-Shannon divergence, from 0 to 1"
    )
    alike = card(
        "Which are alike",
        "Left: the further to the left two groups join, the less alike they are. Right: distances, darker "
        f"is further apart ({unit}). By chance alone, two runs of one scene differ by about {noise:.2f}.",
        draw_tree(comparison, grouping, noise),
    )
    metrics = [m for m, name in enumerate(comparison.metrics) if not name.endswith("_mean")]
    apart = card(
        "Pair by pair", "What sets a pair apart most, with the medians of both.", table_place("pairs")
    )
    curves = card(
        "Densities",
        "How often a value occurs among the children of each scene; upright line: median; in percent the "
        "share of children in which the metric is defined, where that is not all. One colour: one group.",
        plots(*(_ridges(runs, comparison, grouping, m) for m in metrics)),
    )
    about = f"{len(runs)} runs, {grouping.groups} groups" + (", not clearly apart" if fit < 0.25 else "")
    return write_study(
        path, "Seed scenes compared", about, alike, apart, curves, tables={"pairs": _pairs(runs, comparison)}
    )


def kind_of(group: int) -> str:
    """Colour of a group, numbered from 1."""
    return f"c{(group - 1) % _KINDS}"


def _pairs(runs: Sequence[Run], comparison: Comparison) -> dict[str, object]:
    heads = [("one", "text", ""), ("other", "text", ""), ("distance", "real", "Mean over all metrics")]
    heads += [
        ("set apart by", "text", ""),
        ("by", "real", "Distance in this metric"),
        ("medians", "text", ""),
    ]
    first, second = np.triu_indices(len(runs), 1)
    rows = []
    for k in np.argsort(comparison.total[first, second], kind="stable"):
        i, j = int(first[k]), int(second[k])
        metric, distance = comparison.apart(i, j)[0]
        medians = " | ".join(_median(run, metric) for run in (runs[i], runs[j]))
        names = comparison.labels[i], comparison.labels[j]
        rows.append([*names, float(comparison.total[i, j]), metric_title(metric), distance, medians])
    return dict(table(heads, rows))


def _median(run: Run, metric: str) -> str:
    samples = run.samples(metric)
    return f"{np.median(samples):.2f}" if samples.size else "undefined"


def _ridges(runs: Sequence[Run], comparison: Comparison, grouping: Grouping, m: int) -> Html:
    """One metric: a row per run, alike ones side by side."""
    column, count = comparison.metrics[m], len(runs)
    samples = [run.samples(column) for run in runs]
    x = _view(samples, comparison.scales[m])
    plane = Plane(x=x, y=(float(-count), 0.0), height=_ROW_PX * count)
    parts: list[Html] = []
    for row, run in enumerate(int(r) for r in grouping.order):
        foot, kind = float(-row - 1), kind_of(int(grouping.group[run]))
        parts.append(plane.line(np.array(x), np.full(2, foot), "axis"))
        share = samples[run].size / runs[run].children
        parts += _ridge(plane, samples[run], share, foot, kind)
        parts.append(plane.words(x[0], foot + 0.62, comparison.labels[run], anchor="start"))
        if share < 1:
            parts.append(plane.words(x[1], foot + 0.62, f"{share:.0%}", anchor="end"))
    return plane.figure(metric_title(column), *parts)


def _ridge(plane: Plane, samples: FloatArray, share: float, foot: float, kind: str) -> list[Html]:
    finite = samples[np.isfinite(samples)]
    if not finite.size:
        return []
    x = np.linspace(*plane.x, 130)
    height = density(finite, max(BANDWIDTH, _FINEST * (plane.x[1] - plane.x[0])), x=x).pdf
    height *= 0.85 * share / max(float(height.max()), 1e-12)
    found = [plane.area(x, np.full_like(x, foot), foot + height, kind), plane.line(x, foot + height, kind)]
    middle = float(np.median(finite))
    if plane.x[0] <= middle <= plane.x[1]:
        top = foot + float(np.interp(middle, x, height))
        found.append(plane.line(np.full(2, middle), np.array([foot, top]), kind))
    return found


def _view(columns: Sequence[FloatArray], scale: Scale) -> tuple[float, float]:
    """Where the values lie, cut at the fences of the distance."""
    finite = np.concatenate([column[np.isfinite(column)] for column in columns])
    if not finite.size:
        return 0.0, 1.0
    low, high = max(float(finite.min()), scale.low), min(float(finite.max()), scale.high)
    margin = max(0.04 * (high - low), 2 * BANDWIDTH)
    return low - margin, high + margin
