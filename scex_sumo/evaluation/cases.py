"""Values of whole cases, collected from blocks of their scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray
from scex_sumo.evaluation.blocks import Block
from scex_sumo.evaluation.outcomes import after_collision
from scex_sumo.metrics.evaluate import ScenarioValues
from scex_sumo.metrics.extrema import Worst, scene_sums
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.outlines.collisions import Collisions, find_collisions


class Cases:
    """Extrema and means of whole cases, collected block by block."""

    def __init__(self, count: int, metrics: Sequence[Metric], *, outcomes: bool = False) -> None:
        """Begin with no values.

        Args:
            count: number of cases.
            metrics: those that are collected.
            outcomes: collect collisions as well, and tell values of vehicles after they collided.
        """
        size = len(metrics)
        self.outcomes, self.collided = outcomes, np.zeros(count, dtype=np.bool_)
        self.after = np.zeros((count, size), dtype=np.bool_)
        self.order = tuple(metric.name for metric in metrics)
        self.smaller_is_worse = [metric.critical == "min" for metric in metrics]
        self.of_single_vehicles = np.zeros(size, dtype=bool)
        self.value = np.full((count, size), np.nan)
        self.harmonic = [metric.harmonic for metric in metrics]
        self.total, self.counted, self.scenes = (np.zeros((count, size)) for _ in range(3))
        self.origin = np.zeros((count, size, 3), dtype=np.int64)

    def add(self, block: Block, values: ScenarioValues) -> None:
        """Take in the values of a block."""
        hits = find_collisions(block.tracks) if self.outcomes else None
        if hits is not None:
            self.collided[block.case[np.unique(hits.child)]] = True
        for column, name in enumerate(self.order):
            scene, worst = values.scene[name], values.worst[name]
            count, total = scene_sums(scene, harmonic=self.harmonic[column])
            np.add.at(self.total[:, column], block.case, total)
            np.add.at(self.counted[:, column], block.case, count)
            np.add.at(self.scenes[:, column], block.case, scene.defined.sum(axis=1))
            self._keep_worse(column, block, worst, hits)

    def _keep_worse(self, column: int, block: Block, worst: Worst, hits: Collisions | None) -> None:
        now = self.value[block.case, column]
        worse: BoolArray = worst.value < now if self.smaller_is_worse[column] else worst.value > now
        at = np.flatnonzero(worst.defined & (np.isnan(now) | worse))
        case, ids = block.case[at], block.track_id
        self.of_single_vehicles[column] = worst.other is None
        other = worst.vehicle if worst.other is None else worst.other
        self.value[case, column] = worst.value[at]
        if hits is not None:
            pair = worst.vehicle[at], None if worst.other is None else worst.other[at]
            self.after[case, column] = after_collision(hits, at, worst.step[at], *pair)
        self.origin[case, column] = np.stack(
            [
                block.timestamp_ms[at, worst.step[at]],
                ids[at, worst.vehicle[at]],
                ids[at, other[at]],
            ],
            axis=1,
        )

    def scenarios(self, names: pa.Array) -> pa.Table:
        """case_id and two columns per metric, null where undefined."""
        columns: dict[str, Any] = {"case_id": names}
        for column, name in enumerate(self.order):
            undefined = self.scenes[:, column] == 0
            over, under = self.total[:, column], self.counted[:, column]
            if self.harmonic[column]:
                over, under = under, over
            mean = over / np.where(undefined, 1.0, under)
            columns[name] = pa.array(self.value[:, column], mask=undefined)
            columns[f"{name}_mean"] = pa.array(mean, mask=undefined)
        return pa.table(columns | ({"collision": pa.array(self.collided)} if self.outcomes else {}))

    def origins(self, names: pa.Array) -> pa.Table:
        """case_id, metric, timestamp_ms, track_id, other_id, value, with outcomes after_collision."""
        case, column = np.nonzero(self.scenes > 0)
        metric = pa.array(list(self.order), pa.string()).take(pa.array(column))
        stamp, track, other = self.origin[case, column].T
        flag = {"after_collision": pa.array(self.after[case, column])} if self.outcomes else {}
        return pa.table(
            {
                "case_id": names.take(pa.array(case)),
                "metric": metric,
                "timestamp_ms": stamp,
                "track_id": track,
                "other_id": pa.array(other, mask=self.of_single_vehicles[column]),
                "value": self.value[case, column],
                **flag,
            }
        )
