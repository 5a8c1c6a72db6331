"""Densities or cumulative curves of a metric side by side in a chart; atoms as upright lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scex_sumo.arrays import FloatArray
from scex_sumo.metrics.registry import metric_of
from scex_sumo.reports.page.html import Html
from scex_sumo.reports.page.svg import Plane
from scex_sumo.statistics.density import Density

_FAR = 5
"""Ranges between the quartiles that are looked at beside them."""
_LEAST = 0.25


def metric_title(column: str) -> str:
    """A metric as it is printed, with its unit."""
    return metric_of(column).titled() + (", mean" if column.endswith("_mean") else "")


def value_range(values: FloatArray, *marks: float | None) -> tuple[float, float]:
    """Range of an axis: finite values without a far tail, and marks that are near; 0 to 1 without any."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    first, third = np.quantile(finite, [0.25, 0.75])
    reach = _FAR * max(float(third - first), _LEAST)
    low = max(float(finite.min()) - 4 * 0.1, float(first) - reach)
    high = min(float(finite.max()) + 4 * 0.1, float(third) + reach)
    near = 0.5 * (high - low)
    for mark in marks:
        if mark is not None and low - near <= mark <= high + near:
            low, high = min(low, mark - 0.1), max(high, mark + 0.1)
    return low, high


def cumulative_plot(
    column: str,
    curves: Sequence[tuple[str, Density | None]],
    x: tuple[float, float],
    *,
    threshold: float | None = None,
) -> Html:
    """Chart of the cumulative curves of a metric with their bands; arguments as of `density_plot`."""
    plane = Plane(x=x)
    known = [(kind, curve) for kind, curve in curves if curve is not None]
    parts = _threshold(plane, column, threshold) if known else [_nowhere(plane)]
    for kind, curve in known:
        at = np.append(curve.x[(curve.x >= x[0]) & (curve.x < x[1])], x[1])  # on to the right end
        low, high, line = (np.interp(at, curve.x, y) for y in (*curve.band, curve.cdf))
        parts += [plane.area(at, low, high, kind), plane.line(at, line, kind)]
    return plane.figure(metric_title(column), *parts)


def _threshold(plane: Plane, column: str, threshold: float | None) -> list[Html]:
    """The threshold, and what is critical beyond it."""
    if threshold is None:
        return []
    far = plane.x[0] if metric_of(column).side == "left" else plane.x[1]
    line = plane.line(np.full(2, threshold), np.array(plane.y), "critical")
    return [plane.box((threshold, far), plane.y, "critical"), line]


def _nowhere(plane: Plane) -> Html:
    return plane.words(sum(plane.x) / 2, plane.y[1] / 2, "defined in no child")


def density_plot(
    column: str,
    curves: Sequence[tuple[str, Density | None]],
    x: tuple[float, float],
    *,
    threshold: float | None = None,
    note: str = "",
) -> Html:
    """Chart of the densities of a metric.

    Args:
        column: of the metric.
        curves: kind of line, as of `Plane`, and density; None where the metric is defined in no child. The
            first one is filled.
        x: range of the axis.
        threshold: from which on a child is critical; None for none.
        note: below the chart.
    """
    known = [(kind, curve) for kind, curve in curves if curve is not None]
    seen = [curve.pdf[(curve.x >= x[0]) & (curve.x <= x[1])] for _, curve in known]
    plane = Plane(x=x, y=(0.0, 1.08 * max([1e-9, *(float(pdf.max(initial=0.0)) for pdf in seen)])))
    parts = _threshold(plane, column, threshold) if known else [_nowhere(plane)]
    most = max([1e-9, *(atom.share for _, curve in known for atom in curve.atoms)])
    for number, (kind, curve) in enumerate(known):
        inside = (curve.x >= x[0]) & (curve.x <= x[1])
        at, pdf = curve.x[inside], curve.pdf[inside]
        if not number and at.size:
            parts.append(plane.area(at, np.zeros_like(pdf), pdf, kind))
        parts += [plane.line(at, pdf, kind)] if at.size else []
        for atom in curve.atoms:
            if x[0] <= atom.value <= x[1]:
                top = 0.9 * plane.y[1] * atom.share / most
                parts.append(plane.line(np.full(2, atom.value), np.array([0.0, top]), kind))
    return plane.figure(metric_title(column), *parts, note=note)
