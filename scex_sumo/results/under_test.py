"""Vehicles under test: the criticality of their encounters with and without the models under test.

Metrics count pairs with such a vehicle. In the baseline they have drawn models and all else is the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray, numbers_in
from scex_sumo.base.errors import ResultError
from scex_sumo.metrics.registry import COLLISION, Metric, column_named
from scex_sumo.results.design import is_critical, metric_density
from scex_sumo.results.run import UNDER_TEST, Run
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.statistics.density import Density, Interval
from scex_sumo.statistics.paired import mcnemar, signed_rank, signs

Driven = Literal["under_test", "baseline"]


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference of a metric between futures with the models under test and without.

    Attributes:
        under_test: median with the models under test; NaN if defined in no future.
        futures: number of futures with a value in both.
        worse: futures in which the models under test are more critical.
        p_value: Wilcoxon's signed-rank test for no difference in the values; NaN if no future differs.
        p_critical: share of critical futures with the models under test; None without a threshold.
        newly_critical: futures that are critical with the models under test only.
        critical_p_value: McNemar's exact test for no difference in the shares; NaN if undefined.
    """

    column: str
    under_test: float
    baseline: float
    futures: int
    worse: int
    better: int
    p_value: float
    p_critical: Interval | None
    baseline_p_critical: Interval | None
    newly_critical: int
    no_longer_critical: int
    critical_p_value: float


@dataclass(frozen=True, kw_only=True, eq=False)
class UnderTest:
    """Vehicles under test of a run, against its baseline.

    Attributes:
        vehicles: model by track id; None: as drawn.
        metrics: one row per future over the vehicles' own pairs, null where undefined.
        baseline: the same without the models under test.
        runs: the run and its baseline.
        injuries: (C,) expected severe injuries (MAIS 3+) in the vehicles' own collisions.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> run = scex.extrapolate(scene, futures=4, under_test={8: "emergency_brake"})
        >>> scex.UnderTest.of(run).vehicles
        {8: 'emergency_brake'}
    """

    vehicles: Mapping[int, str | None]
    metrics: pa.Table
    baseline: pa.Table
    runs: Mapping[Driven, Run]
    injuries: Mapping[Driven, FloatArray]

    @classmethod
    def of(cls, run: Run) -> UnderTest:
        """Return the vehicles under test of a run; a `ResultError` without any, or without a baseline."""
        known = run.info.get("under_test") or {}
        if not known:
            raise ResultError(
                f"{run.folder}: no vehicle is under test; run with --under-test TRACK=MODEL, "
                "or --assign TRACK=package.module:Class"
            )
        if run.baseline is None:
            raise ResultError(f"{run.folder}: its baseline was not run; run again")
        driven: dict[Driven, Run] = {"under_test": run, "baseline": run.baseline}
        hits = {name: _own_collisions(result, known) for name, result in driven.items()}
        tested, without = (
            _with_collisions(result.table(UNDER_TEST), hits[name]) for name, result in driven.items()
        )
        if without["future"] != tested["future"]:
            raise ResultError(f"{run.baseline.folder}: its futures are not those of {run.folder}; run again")
        return cls(
            vehicles={int(track): model for track, model in known.items()},
            metrics=tested,
            baseline=without,
            runs=driven,
            injuries={name: _injuries(hits[name], result.futures) for name, result in driven.items()},
        )

    @property
    def columns(self) -> list[str]:
        """The metric columns, and ``collision``."""
        return [name for name in self.metrics.column_names if name != "future"]

    @property
    def _run(self) -> Run:
        return self.runs["under_test"]

    @property
    def label(self) -> str:
        """``vehicle 17: mypkg:MyDriver``, several joined."""
        return ", ".join(f"vehicle {track}: {model}" for track, model in self.vehicles.items())

    def values(self, column: str, driven: Driven = "under_test") -> FloatArray:
        """Return the values (C,) of a metric in all futures, NaN where undefined."""
        table = self.metrics if driven == "under_test" else self.baseline
        return numbers_in(table[column_named(column, self.columns)])

    def metric(self, column: str) -> Metric:
        """Return the metric of a column."""
        return self._run.metric(column)

    def samples(self, column: str, driven: Driven = "under_test") -> FloatArray:
        """Return the values (n,) of a metric in the futures where it is defined."""
        values = self.values(column, driven)
        return values[~np.isnan(values)]

    def density(self, column: str, driven: Driven = "under_test") -> Density:
        """Return density and cumulative density of a metric with its 95 % band."""
        values = self.values(column, driven)
        return metric_density(values, self.runs[driven].intervals.half_width(values))

    def p_critical(self, column: str, driven: Driven = "under_test") -> Interval | None:
        """Return the share of critical futures with its 95 % interval; None without a threshold."""
        if (limit := self._limit(column_named(column, self.columns))) is None:
            return None
        values = self.values(column, driven)
        return self.runs[driven].intervals.share(is_critical(values, self.metric(column), limit))

    def _limit(self, column: str) -> float | None:
        return (self._run.thresholds | {COLLISION: 1.0}).get(column)

    def difference(self, column: str) -> Difference:
        """Compare each future with its baseline."""
        tested, baseline = self.values(column), self.values(column, "baseline")
        both = ~np.isnan(tested) & ~np.isnan(baseline)
        sign = -1.0 if self.metric(column).side == "left" else 1.0
        known = self._limit(column)
        limit = float("nan") if known is None else known  # without a threshold no future is critical
        change = signs(sign * tested[both], sign * baseline[both])
        critical = [is_critical(values[both], self.metric(column), limit) for values in (tested, baseline)]
        newly, no_longer = (int((a & ~b).sum()) for a, b in (critical, critical[::-1]))
        return Difference(
            column=column,
            under_test=_median(tested),
            baseline=_median(baseline),
            futures=int(both.sum()),
            worse=int((change > 0).sum()),
            better=int((change < 0).sum()),
            p_value=signed_rank(tested[both], baseline[both]),
            p_critical=self.p_critical(column),
            baseline_p_critical=self.p_critical(column, "baseline"),
            newly_critical=newly,
            no_longer_critical=no_longer,
            critical_p_value=float("nan") if np.isnan(limit) or not both.any() else mcnemar(newly, no_longer),
        )


def _median(values: FloatArray) -> float:
    return float(np.nan if np.isnan(values).all() else np.nanmedian(values))


def _own_collisions(run: Run, vehicles: Iterable[str]) -> pa.Table:
    """Return the first contacts of some vehicles."""
    hits, own = first_contacts(run.collisions), [int(track) for track in vehicles]
    pairs = np.array([np.asarray(hits[name]) for name in ("track_id", "other_id")])
    return hits.filter(np.isin(pairs, own).any(axis=0))


def _with_collisions(table: pa.Table, collisions: pa.Table) -> pa.Table:
    hit = np.isin(np.asarray(table["future"]), np.asarray(collisions["future"])).astype(np.float64)
    return table.add_column(1, COLLISION, pa.array(hit))


def _injuries(collisions: pa.Table, futures: int) -> FloatArray:
    """Return (C,) expected severe injuries in collisions."""
    risks = [np.asarray(collisions[name].fill_null(0.0)) for name in ("p_mais3", "p_mais3_other")]
    future = np.asarray(collisions["future"])
    return np.bincount(future, np.sum(risks, axis=0), minlength=futures).astype(np.float64)
