"""Metric values of the first seconds of each future, ``horizons.parquet``; futures of up to 3 s have none."""

from __future__ import annotations

from typing import Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray
from scex_sumo.metrics.evaluate import ScenarioValues
from scex_sumo.metrics.extrema import SceneValues, scene_mean
from scex_sumo.metrics.registry import metric_of
from scex_sumo.results.folder import values_table
from scex_sumo.scene import STEP_S

HORIZONS: Final = "horizons.parquet"
HORIZONS_S: Final = (1.0, 2.0, 3.0, 5.0, 8.0)
FIRST_STEPS: Final = 30


def horizons_of(steps: int) -> tuple[float, ...]:
    """Return the times, s, by which futures of some steps are told, too."""
    return tuple(t for t in HORIZONS_S if t < STEP_S * steps - 1e-9) if steps > FIRST_STEPS else ()


def horizons_table(values: ScenarioValues, futures: IntArray, steps: int) -> pa.Table | None:
    """Tabulate the metric columns by ``future`` and ``until_s``; None for short futures."""
    tables = []
    for until_s in horizons_of(steps):
        columns = []
        for name, scene in values.scene.items():
            metric, first = metric_of(name), slice(0, round(until_s / STEP_S))
            early = SceneValues(value=scene.value[:, first], defined=scene.defined[:, first])
            sign = 1.0 if metric.critical == "min" else -1.0
            least = np.where(early.defined, sign * early.value, np.inf).min(axis=1)
            columns += [sign * least, scene_mean(early, harmonic=metric.harmonic)]
        defined = [scene.defined[:, : round(until_s / STEP_S)].any(axis=1) for scene in values.scene.values()]
        table = values_table(
            values.columns,
            np.stack(columns, axis=1),
            np.repeat(np.stack(defined, axis=1), 2, axis=1),
            futures,
        )
        tables.append(table.add_column(1, "until_s", pa.array(np.full(len(futures), until_s))))
    return pa.concat_tables(tables) if tables else None
