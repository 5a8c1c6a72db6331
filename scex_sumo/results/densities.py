"""Densities of a run's metrics, with bands for its design."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray
from scex_sumo.results.design import column_of
from scex_sumo.statistics.density import BANDWIDTH, Density, density, mixed_density
from scex_sumo.statistics.intervals import DesignIntervals

DENSITIES = "densities.parquet"
DENSITIES_SCHEMA = pa.schema(
    [("metric", pa.string()), *((name, pa.float64()) for name in ("x", "pdf", "cdf", "low", "high", "atom"))]
)


def metric_density(
    values: FloatArray, half_width: float, *, reflect: bool, bandwidth: float = BANDWIDTH
) -> Density:
    """Return density and cumulative density of a metric (C,), NaN where undefined, with its 95 % band.

    Args:
        reflect: separate atoms, and reflect at 0 if no value is negative; False is the plain kernel.
        bandwidth: of the kernel, in the metric's unit.
    """
    samples = values[~np.isnan(values)]
    if reflect:
        return mixed_density(samples, bandwidth, half_width=half_width)
    return density(samples, bandwidth, half_width=half_width)


def half_widths(metrics: pa.Table, columns: Sequence[str], intervals: DesignIntervals) -> dict[str, float]:
    """Return the half-width of the band of each column."""
    if not columns:
        return {}
    values = np.stack([column_of(metrics, column) for column in columns], axis=1)
    return dict(zip(columns, intervals.half_widths(values).tolist(), strict=True))


def densities_table(
    metrics: pa.Table, columns: Sequence[str], intervals: DesignIntervals, *, reflect: bool
) -> pa.Table:
    """Return the rows of ``densities.parquet``: metric, x, pdf, cdf, low, high, atom.

    ``atom`` is the share of the defined children with exactly this x. A metric that is never defined has no
    rows.
    """
    parts = [DENSITIES_SCHEMA.empty_table()]
    widths = half_widths(metrics, columns, intervals)
    for column in columns:
        values = column_of(metrics, column)
        if np.isnan(values).all():
            continue
        curve = metric_density(values, widths[column], reflect=reflect)
        atom = np.zeros(len(curve.x))
        atom[np.searchsorted(curve.x, [a.value for a in curve.atoms])] = [a.share for a in curve.atoms]
        low, high = curve.band
        data = {"x": curve.x, "pdf": curve.pdf, "cdf": curve.cdf, "low": low, "high": high, "atom": atom}
        names = pa.repeat(pa.scalar(column), len(curve.x))
        parts.append(pa.table({"metric": names, **data}, schema=DENSITIES_SCHEMA))
    return pa.concat_tables(parts)
