"""Design of a run: how its models were drawn, and the intervals that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.registry import side_of
from scex_sumo.statistics.intervals import DesignIntervals


def design_intervals(
    assignment: IntArray, weights: Sequence[float], fixed: BoolArray, design: str
) -> DesignIntervals:
    """Return the intervals of the children of a run.

    Args:
        assignment: (C, V) model of every vehicle; models that are drawn come first.
        fixed: (V,) vehicles that always have the same model.
    """
    share = np.asarray(weights, dtype=np.float64) / np.sum(weights)
    levels = np.where(fixed, 0, assignment)
    shares = [np.ones(1) if always else share for always in fixed]
    return DesignIntervals(levels, design=design, shares=shares)


def intervals_of(info: Mapping[str, Any], assignments: pa.Table | None, children: int) -> DesignIntervals:
    """Return the intervals from ``run.json``; without the assignments, those of independent draws."""
    tracks = info["seed_scene"].get("track_ids", ())
    if assignments is None or not tracks:
        return DesignIntervals(np.zeros((children, 0), dtype=np.int64), design="random")
    always = info.get("assign") or {}
    models = [entry["model"] for entry in info["models"]]
    place = {name: k for k, name in enumerate([*models, *sorted(set(always.values()) - set(models))])}
    coded = assignments["model"].combine_chunks().dictionary_encode()
    number = np.array([place[name] for name in coded.dictionary.to_pylist()], dtype=np.int64)
    drawn = number[np.asarray(coded.indices)].reshape(children, len(tracks))
    fixed = np.array([str(track) in always for track in tracks], dtype=np.bool_)
    return design_intervals(drawn, [entry["weight"] for entry in info["models"]], fixed, info["design"])


def is_critical(values: FloatArray, column: str, limit: float) -> BoolArray:
    """Return whether the values (C,) of a metric column are critical; undefined ones (NaN) are not."""
    with np.errstate(invalid="ignore"):
        critical: BoolArray = values <= limit if side_of(column) == "left" else values >= limit
    return critical


def column_of(table: pa.Table, column: str) -> FloatArray:
    """Return the values (C,) of a metric column, NaN where undefined."""
    return np.asarray(table[column].to_numpy(zero_copy_only=False), dtype=np.float64)
