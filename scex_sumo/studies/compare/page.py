"""Page of a comparison, and its lines in the terminal: tree of runs, distances, metrics that differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from math import sqrt
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.registry import metric_of
from scex_sumo.page.figures.charts import Plane, metric_title
from scex_sumo.page.html import Html, element
from scex_sumo.page.study import Column, Table, card, page_table, plots, table_place, write_study
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import BANDWIDTH, density
from scex_sumo.studies.compare.compare import Comparison, Grouping, Scale

HTML = "compare.html"
MAX_IN_MATRIX = 20  # runs whose matrix fits a terminal of 110 characters
MAX_PAIRS = 15
_KINDS = 6
_RIDGE_PX = 34
_COLUMNS = (
    Column("one", "one"),
    Column("other", "other"),
    Column("total", "distance", "real", "Mean over all metrics"),
    Column("title", "set apart by"),
    Column("by", "by", "real", "Distance in this metric"),
    Column("medians", "medians"),
)
_FINEST = 1 / 60
"""Of the axis: a bandwidth below this is a comb, not a curve."""


def write_comparison(runs: Sequence[Run], comparison: Comparison, grouping: Grouping, path: Path) -> Path:
    """Write the page of a comparison to an HTML file."""
    noise, fit = comparison.chance, float(grouping.silhouette.mean())
    alike = card(
        "Which are similar",
        "Left: the further to the left two groups join, the less similar they are. Right: distances, darker "
        f"is larger ({comparison.unit}). By chance alone, two runs of one scene differ by about "
        f"{noise:.2f}.",
        draw_tree(comparison, grouping, noise),
    )
    metrics = [m for m, name in enumerate(comparison.metrics) if not name.endswith("_mean")]
    apart = card(
        "Pair by pair", "What sets a pair apart most, with the medians of both.", table_place("pairs")
    )
    curves = card(
        "Densities",
        "How often a value occurs among the futures of each scene; upright line: median; in percent the "
        "share of futures in which the metric is defined, unless all. One colour: one group.",
        plots(*(_ridges(runs, comparison, grouping, m) for m in metrics)),
    )
    about = f"{len(runs)} runs, {grouping.groups} groups" + (", not clearly apart" if fit < 0.25 else "")
    return write_study(
        path, "Seed scenes compared", about, alike, apart, curves, tables={"pairs": _pairs(runs, comparison)}
    )


def kind_of(group: int) -> str:
    """Return the colour of a group, numbered from 1."""
    return f"c{(group - 1) % _KINDS}"


def _pairs(runs: Sequence[Run], comparison: Comparison) -> Table:
    first, second = np.triu_indices(len(runs), 1)
    rows = []
    for k in np.argsort(comparison.total[first, second], kind="stable"):
        i, j = int(first[k]), int(second[k])
        metric, by = comparison.apart(i, j)[0]
        one, other = comparison.labels[i], comparison.labels[j]
        medians = " | ".join(_median(run, metric) for run in (runs[i], runs[j]))
        total, title = float(comparison.total[i, j]), metric_title(metric)
        rows.append(
            {"one": one, "other": other, "total": total, "title": title, "by": by, "medians": medians}
        )
    return page_table(_COLUMNS, rows)


def _median(run: Run, metric: str) -> str:
    samples = run.samples(metric)
    return f"{np.median(samples):.2f}" if samples.size else "undefined"


def _ridges(runs: Sequence[Run], comparison: Comparison, grouping: Grouping, m: int) -> Html:
    column, count = comparison.metrics[m], len(runs)
    samples = [run.samples(column) for run in runs]
    x = _view(samples, comparison.scales[m])
    plane = Plane(x=x, y=(float(-count), 0.0), height=_RIDGE_PX * count)
    parts: list[Html] = []
    for row, run in enumerate(int(r) for r in grouping.order):
        foot, kind = float(-row - 1), kind_of(int(grouping.group[run]))
        parts.append(plane.line(np.array(x), np.full(2, foot), "axis"))
        share = samples[run].size / runs[run].futures
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
    width = max(BANDWIDTH, _FINEST * (plane.x[1] - plane.x[0]))
    height = density(finite, width, x=x, reflect=bool(finite.min() >= 0)).pdf
    height *= 0.85 * share / max(float(height.max()), 1e-12)
    elements = [plane.area(x, np.full_like(x, foot), foot + height, kind), plane.line(x, foot + height, kind)]
    middle = float(np.median(finite))
    if plane.x[0] <= middle <= plane.x[1]:
        top = foot + float(np.interp(middle, x, height))
        elements.append(plane.line(np.full(2, middle), np.array([foot, top]), kind))
    return elements


def _view(columns: Sequence[FloatArray], scale: Scale) -> tuple[float, float]:
    finite = np.concatenate([column[np.isfinite(column)] for column in columns])
    if not finite.size:
        return 0.0, 1.0
    low, high = max(float(finite.min()), scale.low), min(float(finite.max()), scale.high)
    margin = max(0.04 * (high - low), 2 * BANDWIDTH)
    return low - margin, high + margin


_TREE_PX, _ROW_PX, _LETTER_PX, _GAP_PX = 170, 24, 7.4, 8
_NUMBERS_UP_TO = 20
"""Runs whose distances are written into the matrix."""


def draw_tree(comparison: Comparison, grouping: Grouping, noise: float) -> Html:
    """Draw the tree, shaded below ``noise``, with the names and the matrix of distances."""
    order = [int(run) for run in grouping.order]
    wide = _LETTER_PX * max(len(name) for name in comparison.labels) + 2 * _GAP_PX
    left, height = _TREE_PX + wide, _ROW_PX * len(order)
    parts = [*_branches(grouping, noise, height)]
    for row, run in enumerate(order):
        color = kind_of(int(grouping.group[run]))
        y = _ROW_PX * row + 16
        parts.append(element(f"text.leaf.{color}", comparison.labels[run], x=_TREE_PX + _GAP_PX, y=y))
        parts += _row(comparison, order, run, row, left)
    whole = f"0 0 {left + _ROW_PX * 1.6 * len(order):.0f} {height + 4}"
    width = int(left + _ROW_PX * 1.6 * len(order))
    drawing = element("svg", *parts, viewBox=whole, width=width, height=height + 4, role="img")
    return element("div.scroll", drawing)


def _row(comparison: Comparison, order: list[int], run: int, row: int, left: float) -> list[Html]:
    total, most = comparison.total, max(float(comparison.total.max()), 1e-9)
    elements = []
    for column, other in enumerate(order):
        value, x = float(total[run, other]), left + 1.6 * _ROW_PX * column
        ink = f"{value / most:.2f}"
        size: dict[str, str | int] = {"width": f"{1.6 * _ROW_PX - 1:.1f}", "height": _ROW_PX - 1}
        elements.append(element("rect.cell", x=f"{x:.1f}", y=_ROW_PX * row, fill_opacity=ink, **size))
        if run != other and len(order) <= _NUMBERS_UP_TO:
            kind = "text.light" if value > 0.6 * most else "text.dark"
            place: dict[str, str | int] = {"x": f"{x + 0.8 * _ROW_PX:.1f}", "y": _ROW_PX * row + 16}
            elements.append(element(kind, f"{value:.2f}", text_anchor="middle", **place))
    return elements


def _branches(grouping: Grouping, noise: float, height: int) -> list[Html]:
    count = len(grouping.order)
    top = max(float(grouping.linkage[-1, 2]), noise if noise == noise else 0.0, 1e-9)

    def x_of(distance: float) -> float:
        return _TREE_PX * (1 - 0.97 * sqrt(max(distance, 0.0) / top))

    place = {int(run): _ROW_PX * (row + 0.5) for row, run in enumerate(grouping.order)}
    depth = dict.fromkeys(place, 0.0)
    group: dict[int, int] = {run: int(grouping.group[run]) for run in place}
    elements = []
    if noise == noise and noise > 0:
        x = x_of(noise)
        box: dict[str, str | int] = {"x": f"{x:.1f}", "width": f"{_TREE_PX - x:.1f}", "height": height}
        elements.append(element("rect.chance", element("title", "by chance"), y=0, **box))
    for step, (one, two, at, _) in enumerate(grouping.linkage):
        parts, joined = (int(one), int(two)), count + step
        same = group[parts[0]] if group[parts[0]] == group[parts[1]] else 0
        color = kind_of(same) if same else "soft"
        (x, low), (right, high) = (
            (x_of(depth[parts[0]]), place[parts[0]]),
            (x_of(depth[parts[1]]), place[parts[1]]),
        )
        middle = x_of(float(at))
        elements.append(
            element(f"path.line.{color}", d=f"M{x:.1f},{low:.1f}H{middle:.1f}V{high:.1f}H{right:.1f}")
        )
        place[joined], depth[joined], group[joined] = (low + high) / 2, float(at), same
    return elements


def comparison_lines(
    runs: Sequence[Run], comparison: Comparison, grouping: Grouping, centre: int | None
) -> Iterable[str]:
    """Yield the lines that the terminal shows.

    Args:
        centre: the run whose neighbours are listed; None lists pairs, or the nearest run of each.
    """
    names, count = comparison.labels, len(runs)
    about = f"{count} runs, distance {comparison.kind}: mean over {len(comparison.metrics)} metrics"
    yield f"{about}; {comparison.unit}"
    yield f"by chance alone, two runs of one seed scene differ by about {comparison.chance:.2f}"
    told = [(label, run.collision.percent) for label, run in zip(names, runs, strict=True) if run.outcomes]
    if 0 < len(told) <= MAX_IN_MATRIX:
        yield "P(collision), 95 % interval:"
        wide = max(len(label) for label in names)
        yield from (f"  {label:<{wide}} {percent}" for label, percent in told)
    yield ""
    yield from _matrix(comparison, grouping)
    if count > 2:
        yield from _groups(comparison, grouping)
    if centre is not None:
        yield f"nearest to {names[centre]}:"
        for place, other in enumerate(comparison.nearest(centre), 1):
            yield f"  {place:>2}. {_pair(runs, comparison, centre, int(other))}"
        return
    if count * (count - 1) // 2 <= MAX_PAIRS:
        yield "pairs, the most similar first, and what sets them apart most:"
        i, j = np.triu_indices(count, 1)
        for k in np.argsort(comparison.total[i, j], kind="stable"):
            yield f"  {names[i[k]]} | {_pair(runs, comparison, int(i[k]), int(j[k]))}"
        return
    yield "nearest neighbours, and what sets them apart most:"
    for run in grouping.order:
        yield f"  {names[run]} > {_pair(runs, comparison, int(run), int(comparison.nearest(run)[0]))}"
    most = Counter(comparison.apart(i, j)[0][0] for i in range(count) for j in range(i))
    shares = ", ".join(f"{metric} {n}" for metric, n in most.most_common())
    yield f"what sets the {sum(most.values())} pairs apart most: {shares}"


def _matrix(comparison: Comparison, grouping: Grouping) -> Iterable[str]:
    order = [int(r) for r in grouping.order]
    if len(order) > MAX_IN_MATRIX:
        yield f"(the matrix of more than {MAX_IN_MATRIX} runs: -o FOLDER, distances.csv and compare.html)"
        yield ""
        return
    wide = max(len(comparison.labels[r]) for r in order)
    yield f"{'distance x 100':<{wide + 3}}" + "".join(f"{n:>4}" for n in range(1, len(order) + 1))
    for row, run in enumerate(order):
        cells = [f"{100 * comparison.total[run, other]:>4.0f}" for other in order[:row]]
        yield f"{row + 1:>2} {comparison.labels[run]:<{wide}}{''.join(cells)}   ."
    yield ""


def _groups(comparison: Comparison, grouping: Grouping) -> Iterable[str]:
    fit = float(grouping.silhouette.mean())
    quality = f"mean silhouette {fit:.2f}" + (", not clearly apart" if fit < 0.25 else "")
    yield f"{grouping.groups} groups (Ward, {quality}):"
    for number in range(1, grouping.groups + 1):
        members = [comparison.labels[r] for r in grouping.order if grouping.group[r] == number]
        yield f"  {number}: {', '.join(members)}"
    yield ""


def _pair(runs: Sequence[Run], comparison: Comparison, run: int, other: int) -> str:
    metric, distance = comparison.apart(run, other)[0]
    line = f"{comparison.labels[other]}: {comparison.total[run, other]:.2f}"
    if distance == 0:
        return f"{line}; nothing sets them apart"
    medians = " | ".join(_typical(runs[r], metric) for r in (run, other))
    return f"{line}; {metric} {distance:.2f} (median {medians})"


def _typical(run: Run, metric: str) -> str:
    samples = run.samples(metric)
    share = len(samples) / run.futures
    if share == 0:
        return "undefined"
    text = f"{np.median(samples):.2f} {metric_of(metric).column_unit}".rstrip()
    return text if share == 1 else f"{text}, defined in {share:.0%}"
