"""Design of a run: how its models were drawn, the intervals and the bands of densities that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, numbers_in
from scex_sumo.base.errors import ResultError
from scex_sumo.metrics.registry import Metric
from scex_sumo.results.tables.columns import schema
from scex_sumo.statistics.density import Density, density
from scex_sumo.statistics.intervals import DesignIntervals


def intervals_of(info: Mapping[str, Any], assignments: pa.Table | None, futures: int) -> DesignIntervals:
    """Return the intervals from ``run.json``; without the assignments, those of independent draws.

    Raises:
        ResultError: the assignments name a model that the run does not have.
    """
    tracks = info["seed_scene"].get("track_ids", ())
    if assignments is None or not tracks:
        return DesignIntervals(np.zeros((futures, 0), dtype=np.int64), design="random", shares=())
    assigned = info.get("assign") or {}
    models = [entry["model"] for entry in info["models"]]
    coded = assignments["model"].combine_chunks().dictionary_encode()
    walking = {name for weights in info.get("people", {}).values() for name in weights}
    others = sorted((set(assigned.values()) | walking) - set(models))
    place = {name: k for k, name in enumerate([*models, *others])}
    names = coded.dictionary.to_pylist()
    if strange := [name for name in names if name not in place]:
        raise ResultError(f"assignments.parquet: {strange[0]!r} is no model of this run")
    number = np.array([place[name] for name in names], dtype=np.int64)
    drawn = number[np.asarray(coded.indices)].reshape(futures, len(tracks))
    people = info["seed_scene"].get("people", ())
    fixed = np.array([str(track) in assigned or track in people for track in tracks], dtype=np.bool_)
    weights = np.array([entry["weight"] for entry in info["models"]], dtype=np.float64)
    shares = [np.ones(1) if is_fixed else weights / weights.sum() for is_fixed in fixed]
    return DesignIntervals(np.where(fixed, 0, drawn), design=info["design"], shares=shares)


def is_critical(values: FloatArray, metric: Metric, limit: float) -> BoolArray:
    """Return whether the values (C,) of a metric are critical; undefined ones (NaN) are not."""
    with np.errstate(invalid="ignore"):
        critical: BoolArray = values <= limit if metric.critical == "min" else values >= limit
    return critical


DENSITIES = "densities.parquet"
DENSITIES_SCHEMA = schema("metric x pdf cdf low high atom")


def metric_density(values: FloatArray, half_width: float) -> Density:
    """Return density and cumulative density of a metric (C,), NaN where undefined, with its 95 % band."""
    known = values[~np.isnan(values)]
    folds = bool(known.min(initial=0.0) >= 0)
    return density(known, reflect=folds, atoms=True, half_width=half_width)


def half_widths(metrics: pa.Table, columns: Sequence[str], intervals: DesignIntervals) -> dict[str, float]:
    """Return the half-width of the band of each column."""
    if not columns:
        return {}
    values = np.stack([numbers_in(metrics[column]) for column in columns], axis=1)
    return dict(zip(columns, intervals.half_widths(values).tolist(), strict=True))


def densities_table(metrics: pa.Table, columns: Sequence[str], intervals: DesignIntervals) -> pa.Table:
    """Return the rows of ``densities.parquet``: metric, x, pdf, cdf, low, high, atom.

    ``atom`` is the share of the defined futures with exactly this x. A metric that is never defined has no
    rows.
    """
    parts = [DENSITIES_SCHEMA.empty_table()]
    widths = half_widths(metrics, columns, intervals)
    for column in columns:
        values = numbers_in(metrics[column])
        if np.isnan(values).all():
            continue
        curve = metric_density(values, widths[column])
        atom = np.zeros(len(curve.x))
        atom[np.searchsorted(curve.x, [a.value for a in curve.atoms])] = [a.share for a in curve.atoms]
        low, high = curve.band
        data = {"x": curve.x, "pdf": curve.pdf, "cdf": curve.cdf, "low": low, "high": high, "atom": atom}
        names = pa.repeat(pa.scalar(column), len(curve.x))
        parts.append(pa.table({"metric": names, **data}, schema=DENSITIES_SCHEMA))
    return pa.concat_tables(parts)
