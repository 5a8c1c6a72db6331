"""Scores of a validation as tables: events, pairs, continuous values, positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.events import MEASURED
from scex_sumo.metrics.registry import COLLISION, THRESHOLDS, metric_of
from scex_sumo.reports.words import counted
from scex_sumo.results.design import is_critical
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.validate.moment import CONSTANT_VELOCITY, RECORDED, Forecast
from scex_sumo.studies.validate.scores import brier, covered, crps, group_bootstrap, reliability, skill


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happens, or not, in a future or in a recording.

    Attributes:
        column: metric column, or ``collision``.
        threshold: from which value on it has happened.
        paper: one of the four that the paper suggests.
    """

    name: str
    column: str
    threshold: float = 0.5
    paper: bool = False

    def happened(self, value: FloatArray) -> BoolArray:
        """Return whether it happened, from values of its column; undefined (NaN) is no event."""
        return is_critical(value, metric_of(self.column), self.threshold)


def _paper(column: str, threshold: float) -> Event:
    metric = metric_of(column)
    name = f"{metric.label or column} {metric.sign} {threshold:.3g}"
    return Event(name=name, column=column, threshold=threshold, paper=True)


EVENTS: Final = (
    *(_paper(column, threshold) for column, threshold in THRESHOLDS.items()),
    Event(name="collision", column=COLLISION),
    Event(name="THW < 1 s", column="thw", threshold=1.0),
    Event(name="TTC on path < 4 s", column="ttc_path", threshold=0.25),
    Event(name="PET < 2 s", column="pet", threshold=2.0),
    Event(name="body gap < 1 m", column="gap", threshold=1.0),
)
"""All events, those of the paper first."""


MIN_SEEDS = 20
"""Number of seed scenes below which a validation compares nothing."""
MIN_DEFINED = 0.5  # share of the futures in which a metric must be defined to forecast its value
SCORED_UP_TO: Final = {"s": 10.0, "1/s": 10.0, "m/s²": 20.0}
"""Value of a metric column in each unit from which on all values, inf too, are scored as equal.

A closing speed near 0 makes a PTTC of 1e15 s, which would decide the mean score alone.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Forecasts:
    """All M moments of a validation: K metric columns, then ``collision``, NaN where undefined.

    Values (C, K) of the futures of each, (M, K) what was recorded and constant velocity; ``group`` (M,) is
    the recording.
    """

    columns: tuple[str, ...]
    futures: Sequence[FloatArray]
    recorded: FloatArray
    straight: FloatArray
    group: IntArray
    vehicles: pa.Table
    encounters: pa.Table


def gathered(scored: Sequence[tuple[MomentRef, Forecast]]) -> Forecasts:
    """Return the forecasts of all moments."""
    columns = tuple(name for name in scored[0][1].futures.column_names if name != "future")
    names = sorted({ref.recording for ref, _ in scored})
    group = np.array([names.index(ref.recording) for ref, _ in scored])
    parts = [_matrix(forecast.futures, columns) for _, forecast in scored]

    def row(number: int) -> FloatArray:
        return np.stack([values[future == number][0] for future, values in parts])

    pairs = [forecast.encounters for _, forecast in scored]
    marked = [
        t.append_column("group", pa.array(np.full(len(t), g))) for t, g in zip(pairs, group, strict=True)
    ]
    return Forecasts(
        columns=columns,
        futures=[values[future >= 0] for future, values in parts],
        recorded=row(RECORDED),
        straight=row(CONSTANT_VELOCITY),
        group=group,
        vehicles=pa.concat_tables([forecast.vehicles for _, forecast in scored]),
        encounters=pa.concat_tables(marked),
    )


def _matrix(table: pa.Table, columns: tuple[str, ...]) -> tuple[IntArray, FloatArray]:
    values = [np.asarray(table[c].to_numpy(zero_copy_only=False), dtype=np.float64) for c in columns]
    return np.asarray(table["future"], dtype=np.int64), np.stack(values, axis=1)


def probability(forecasts: Forecasts, event: Event) -> tuple[FloatArray, BoolArray]:
    """Return forecasts (M,) of an event, and whether it happened."""
    column = forecasts.columns.index(event.column)
    p = np.array([event.happened(values[:, column]).mean() for values in forecasts.futures])
    return p, event.happened(forecasts.recorded[:, column])


def event_scores(forecasts: Forecasts) -> list[dict[str, Any]]:
    """Return one row for each event: Brier score, skills, reliability diagram."""
    rows = []
    for event in EVENTS:
        p, o = probability(forecasts, event)
        straight = event.happened(forecasts.straight[:, forecasts.columns.index(event.column)])
        about = {"event": event.name, "paper": event.paper, "seeds": len(p)}
        rows.append(about | _scores(p, o, straight, forecasts.group))
    return rows


def pair_scores(forecasts: Forecasts) -> list[dict[str, Any]]:
    """Return one row for each of `MEASURED` events; empty without pairs, see `pair_forecasts`."""
    table = forecasts.encounters
    if not len(table):
        return []

    def column(name: str) -> Any:
        return np.array(table[name].to_pylist())

    return [
        {
            "event": event.words,
            "pairs": len(table),
            **_scores(
                column(f"{event.name}_forecast"),
                column(f"{event.name}_happened"),
                column(f"{event.name}_straight"),
                column("group"),
            ),
        }
        for event in MEASURED
    ]


def _scores(p: FloatArray, o: BoolArray, straight: BoolArray, group: IntArray) -> dict[str, Any]:
    """Return the scores of forecasts (N,) of an event, with those of constant velocity."""
    score, plain = brier(p, o), brier(straight.astype(np.float64), o)
    uncertainty = float(o.mean() * (1 - o.mean()))
    low, high = group_bootstrap(lambda index: brier(p[index], o[index]), group)
    return {
        "happened": float(o.mean()),
        "forecast": float(p.mean()),
        "brier": score,
        "brier_low": low,
        "brier_high": high,
        "uncertainty": uncertainty,
        "brier_constant_velocity": plain,
        "skill_base_rate": skill(score, uncertainty),
        "skill_constant_velocity": skill(score, plain),
        **{f"diagram_{name}": values.tolist() for name, values in vars(reliability(p, o)).items()},
    }


def value_scores(forecasts: Forecasts) -> list[dict[str, Any]]:
    """Return one row for each metric column: CRPS, its skill, coverage; values are cut at `SCORED_UP_TO`."""
    rows = []
    for column, name in enumerate(forecasts.columns):
        if name == COLLISION:
            continue
        limit = SCORED_UP_TO.get(metric_of(name).column_unit, np.inf)
        cases: list[tuple[Any, ...]] = []
        for m, values in enumerate(forecasts.futures):
            sample = np.minimum(values[:, column], limit)
            sample = sample[np.isfinite(sample)]
            truth, rival = forecasts.recorded[m, column], forecasts.straight[m, column]
            y, straight = float(min(truth, limit)), float(min(rival, limit))
            if np.isfinite(y) and np.isfinite(straight) and len(sample) >= MIN_DEFINED * len(values):
                cases.append((crps(sample, y), abs(straight - y), covered(sample, y), forecasts.group[m]))
        if cases:
            rows.append({"column": name, **_of_values(*zip(*cases, strict=True))})
    return rows


def _of_values(
    score: Sequence[float], plain: Sequence[float], within: Sequence[bool], group: Sequence[int]
) -> dict[str, Any]:
    reference, hit = float(np.mean(plain)), np.array(within, dtype=np.float64)
    low, high = group_bootstrap(lambda index: float(hit[index].mean()), np.array(group))
    return {
        "count": len(score),
        "crps": float(np.mean(score)),
        "crps_skill": skill(float(np.mean(score)), reference),
        "coverage": float(hit.mean()),
        "coverage_low": low,
        "coverage_high": high,
    }


def position_scores(forecasts: Forecasts) -> list[dict[str, Any]]:
    """Return one row for each second, of moving and of standing vehicles."""
    rows, table = [], forecasts.vehicles
    for second in sorted(set(table["second"].to_pylist())):
        for moving in (True, False):
            vehicles = table.filter(
                pc.and_(pc.equal(table["second"], second), pc.equal(table["moving"], moving))
            )
            if not len(vehicles):
                continue
            means = ("error_of_mean_m", "mean_error_m", "least_error_m", "constant_velocity_error_m")
            rows.append(
                {
                    "second": second,
                    "moving": moving,
                    "vehicles": len(vehicles),
                    **{name: float(np.mean(vehicles[name].to_numpy())) for name in means},
                    **{
                        f"{axis}_coverage": float(np.mean(vehicles[f"{axis}_within"].to_pylist()))
                        for axis in ("along", "across")
                    },
                }
            )
    return rows


def summary(forecasts: Forecasts, events: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the main figures."""
    papers = [score for score in events if score["paper"]]
    p, overlap = probability(forecasts, next(event for event in EVENTS if event.column == COLLISION))
    return {
        "seeds": len(forecasts.group),
        "recordings": len(set(forecasts.group.tolist())),
        "mean_brier": float(np.mean([score["brier"] for score in papers])),
        "mean_brier_base_rate": float(np.mean([score["uncertainty"] for score in papers])),
        "mean_brier_constant_velocity": float(
            np.mean([score["brier_constant_velocity"] for score in papers])
        ),
        "p_collision": float(p.mean()),
        "p_collision_without_overlap": None if overlap.all() else float(p[~overlap].mean()),
        "recorded_overlaps": float(overlap.mean()),
    }


def verdicts(figures: Mapping[str, Any]) -> list[str]:
    """Return warnings on a `summary`: too few seed scenes, or worse than constant velocity."""
    seeds, score, plain = (figures[name] for name in ("seeds", "mean_brier", "mean_brier_constant_velocity"))
    words = []
    if seeds < MIN_SEEDS:
        words.append(f"{counted(seeds, 'seed scene')}: too few to compare; validate on {MIN_SEEDS} or more")
    if score > plain:
        words.append(f"worse than constant velocity: mean Brier score {score:.3f}, not {plain:.3f}")
    return [f"warning: {word}" for word in words]
