"""Comparison of runs as lines and as a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np
import pyarrow as pa

from scex_sumo.metrics.registry import metric_of
from scex_sumo.results.run import Run
from scex_sumo.studies.compare.compare import Comparison, Grouping

MAX_IN_MATRIX = 20  # runs whose matrix fits a terminal of 110 characters
MAX_PAIRS = 15


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
    told = [(label, run.p_collision) for label, run in zip(names, runs, strict=True) if run.outcomes]
    if 0 < len(told) <= MAX_IN_MATRIX:
        yield "P(collision), 95 % interval:"
        wide = max(len(label) for label in names)
        yield from (f"  {label:<{wide}} {p.value:6.1%}  {p.low:.1%} – {p.high:.1%}" for label, p in told)
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
    share = len(samples) / run.children
    if share == 0:
        return "undefined"
    text = f"{np.median(samples):.2f} {metric_of(metric).column_unit}".rstrip()
    return text if share == 1 else f"{text}, defined in {share:.0%}"


def distances_table(comparison: Comparison) -> pa.Table:
    """Return one row for each pair and metric, and one for each pair with metric ``all``."""
    i, j = np.triu_indices(len(comparison.labels), 1)
    names = np.asarray(comparison.labels)
    parts = []
    for m, metric in [(None, "all"), *enumerate(comparison.metrics)]:
        terms = [comparison.values, comparison.undefined]
        values, undefined = [t.mean(axis=2) if m is None else t[:, :, m] for t in terms]
        parts.append(
            pa.table(
                {
                    "first": names[i],
                    "second": names[j],
                    "metric": [metric] * len(i),
                    "distance": (values + undefined)[i, j],
                    "values": values[i, j],
                    "undefined": undefined[i, j],
                }
            )
        )
    return pa.concat_tables(parts)
