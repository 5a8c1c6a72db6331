"""Metrics of longer futures by their first seconds: ``horizons.parquet``."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.metrics.evaluate import ScenarioValues
from scex_sumo.metrics.extrema import SceneValues, scene_mean
from scex_sumo.metrics.registry import Metric
from scex_sumo.results.folder import horizons_of, values_table
from scex_sumo.scene import STEP_S


def horizons_table(
    values: ScenarioValues, metrics: Sequence[Metric], futures: IntArray, steps: int
) -> pa.Table:
    """Tabulate the metric columns by ``future`` and ``until_s``; the futures are longer than 3 s."""
    tables = []
    for until_s in horizons_of(steps):
        columns, defined = [], []
        for metric in metrics:
            scene, first = values.scene[metric.name], slice(0, round(until_s / STEP_S))
            early = SceneValues(value=scene.value[:, first], defined=scene.defined[:, first])
            sign = 1.0 if metric.critical == "min" else -1.0
            least = np.where(early.defined, sign * early.value, np.inf).min(axis=1)
            columns += [sign * least, scene_mean(early, harmonic=metric.harmonic)]
            defined += [early.defined.any(axis=1)] * 2
        table = values_table(values.columns, np.stack(columns, axis=1), np.stack(defined, axis=1), futures)
        tables.append(table.add_column(1, "until_s", pa.array(np.full(len(futures), until_s))))
    return pa.concat_tables(tables)
