"""Explain criticality: the vehicles whose models make values vary, or critical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.registry import COLLISION, column_named, side_of
from scex_sumo.results.probability import Probability, probability_of
from scex_sumo.results.run import Run
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.statistics.density import Interval
from scex_sumo.studies.explain.effects import (
    Cells,
    Condition,
    Effect,
    all_cells,
    conditions,
    covering,
    effects,
)

WORST_SHARE: Final = 0.1
"""The most critical tenth stands in for the critical futures of a metric without threshold."""
RULES: Final = 3
BEYOND: Final = 2.0
"""Times a threshold, the largest value that counts for the variance: a collision has an infinite DRAC."""
MOMENT_MS: Final = 1000  # the seed scene is frame 10 of every future


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Explanation of one metric.

    Attributes:
        defined: number of futures in which it is defined.
        threshold: of criticality; the limit of the most critical tenth if the metric has none.
        given: whether the threshold is the run's.
        p_critical: critical share of all futures.
        worst: most critical futures, the worst first.
    """

    metric: str
    defined: int
    effects: list[Effect]
    threshold: float
    given: bool
    p_critical: Probability
    conditions: list[Condition]
    rules: list[Condition]
    worst: list[int]

    @property
    def always(self) -> bool:
        """Whether every future is critical: no model makes it so."""
        return self.given and self.p_critical.sampled.value == 1

    @property
    def pair(self) -> tuple[int, int] | None:
        """Track ids of the two vehicles whose collision is explained; None for a metric."""
        return pair_of(self.metric)

    def question(self, name: str, signs: tuple[str, str] = ("<=", ">=")) -> str:
        """Return in words what is critical; ``signs`` of the left and the right side."""
        if self.metric == COLLISION:
            return COLLISION
        if self.pair:
            return f"collision of {self.pair[0]} and {self.pair[1]}"
        worst = "" if self.given else ", the worst tenth"
        return f"{name} {signs[side_of(self.metric) != 'left']} {self.threshold:.3g}{worst}"


def explain(
    run: Run, metrics: Sequence[str], *, worst: int = 5, progress: Progress | bool | None = None
) -> list[Explanation]:
    """Explain metrics of a finished run.

    Args:
        metrics: metric columns, ``collision``, or two track ids ``A,B``: whether these two collide.
        worst: how many of the most critical futures are named.
        progress: True for a bar on a terminal or in a notebook; or called with (steps done, steps in all).
    """
    names = [m if pair_of(m) else column_named(m, [*run.outcomes, *run.columns]) for m in metrics]
    values, (levels, _) = [metric_values(run, name) for name in names], assignment_of(run)
    count, pairs = len(names), meeting(run)
    with progress_of(progress, "explain") as shown:
        tick = shown or (lambda done, total: None)
        columns = [_capped(run, name, one) for name, one in zip(names, values, strict=True)]
        effects_of = effects(
            levels, np.stack(columns, axis=1), pairs=pairs, progress=lambda done, _: tick(done, 2 * count)
        )
        cells, explanations = all_cells(levels, pairs), []
        for name, one, parts in zip(names, values, effects_of, strict=True):
            explanations.append(_explain(run, name, one, cells, parts, worst))
            tick(count + len(explanations), 2 * count)
    return explanations


def _capped(run: Run, metric: str, values: FloatArray) -> FloatArray:
    """Return values of which large ones are critical, at most `BEYOND` times their threshold."""
    limit = run.thresholds.get(metric)
    return values if limit is None or side_of(metric) == "left" else np.minimum(values, BEYOND * limit)


def _explain(
    run: Run, metric: str, values: FloatArray, cells: Cells, parts: list[Effect], worst: int
) -> Explanation:
    thresholds = run.thresholds | {COLLISION: 1.0}
    known = ~np.isnan(values)
    column = COLLISION if pair_of(metric) else metric
    sign = 1.0 if side_of(column) == "left" else -1.0
    given = column in thresholds
    limit = float("nan")
    if given:
        limit = thresholds[column]
    elif known.any():
        limit = float(sign * np.quantile(sign * values[known], WORST_SHARE, method="lower"))
    critical = known & (sign * values <= sign * limit)
    order = np.lexsort((np.arange(len(values)), np.where(known, sign * values, np.inf)))
    return Explanation(
        metric=metric,
        defined=int(known.sum()),
        effects=parts,
        threshold=limit,
        given=given,
        p_critical=_probability(run, metric, run.intervals.share(critical)),
        conditions=conditions(cells, critical),
        rules=covering(cells, critical, RULES),
        worst=[int(c) for c in order[: min(worst, int(known.sum()))]],
    )


def _probability(run: Run, metric: str, sampled: Interval) -> Probability:
    """Return the probability of a collision as all places have it, else the share of critical futures."""
    if metric == COLLISION:
        return run.collision
    pair = pair_of(metric)
    return Probability(sampled=sampled) if pair is None else probability_of(run, sampled, COLLISION, pair)


def undefined(explanation: Explanation) -> str:
    """Return in words that a metric is defined in no future, and what encounters count in its place."""
    if explanation.metric not in EVENTS:
        return "defined in no future"
    return f"defined in no future; encounters count a collision as {EVENTS[explanation.metric].words}"


def meeting(run: Run) -> set[tuple[int, int]]:
    """Return the pairs of vehicles, as indices, that meet in some future."""
    place = {track: index for index, track in enumerate(run.info["seed_scene"]["track_ids"])}
    rows = zip(run.encounters["track_id"].to_pylist(), run.encounters["other_id"].to_pylist(), strict=True)
    pairs = (sorted((place[one], place[two])) for one, two in rows)
    return {(one, two) for one, two in pairs}


def pair_of(metric: str) -> tuple[int, int] | None:
    """Return the two track ids of ``A,B``; None for a metric."""
    ids = [part.strip() for part in metric.split(",")]
    if len(ids) != 2 or not all(part.isdecimal() for part in ids):
        return None
    return int(ids[0]), int(ids[1])


def metric_values(run: Run, metric: str) -> FloatArray:
    """Return the values (C,) of a metric; for ``A,B`` 1 in futures in which the two collide, else 0."""
    pair = pair_of(metric)
    if pair is None:
        return run.values(metric)
    table = first_contacts(run.collisions)
    one, two = np.asarray(table["track_id"]), np.asarray(table["other_id"])
    both = np.isin(one, pair) & np.isin(two, pair) & (one != two)
    if not both.any():
        raise UsageError(f"{metric}: these two collide in no future; see scex-sumo encounters {run.folder}")
    return np.isin(np.asarray(run.metrics["future"]), np.asarray(table["future"])[both]).astype(np.float64)


def assignment_of(run: Run) -> tuple[IntArray, list[str]]:
    """Return the model (C, V) of each vehicle in each future, and the models' names."""
    table = run.assignments
    names, flat = np.unique(np.asarray(table["model"].to_pylist(), dtype=str), return_inverse=True)
    vehicles = int(run.info["seed_scene"]["vehicles"])
    return flat.reshape(-1, vehicles).astype(np.int64), [str(n) for n in names]


def effect_rows(explanation: Explanation, track_ids: Sequence[int]) -> list[dict[str, Any]]:
    """Return effects as rows of a table."""
    return [
        {
            "metric": explanation.metric,
            "kind": e.kind,
            "track_id": track_ids[e.vehicle] if e.vehicle >= 0 else None,
            "other_id": track_ids[e.other] if e.other >= 0 else None,
            "share": e.share,
            "raw_share": e.raw_share,
            "degrees": e.degrees,
            "p_value": None if np.isnan(e.p_value) else e.p_value,
        }
        for e in explanation.effects
    ]


def condition_rows(
    explanation: Explanation, track_ids: Sequence[int], names: Sequence[str]
) -> list[dict[str, Any]]:
    """Return conditions as rows of a table."""
    return [
        {
            "metric": explanation.metric,
            "track_id": track_ids[c.vehicles[0]],
            "model": names[c.models[0]],
            "other_id": track_ids[c.vehicles[1]] if len(c.vehicles) > 1 else None,
            "other_model": names[c.models[1]] if len(c.vehicles) > 1 else None,
            "futures": c.futures,
            "critical": c.critical,
            "share": c.share,
            "low": c.low,
            "high": c.high,
            "covered": c.covered,
        }
        for c in explanation.conditions
    ]


def worst_rows(
    run: Run, explanation: Explanation, levels: IntArray, names: Sequence[str]
) -> list[dict[str, Any]]:
    """Return the most critical futures as rows; ``levels`` and ``names`` as of `assignment_of`."""
    track_ids = run.info["seed_scene"]["track_ids"]
    metric = explanation.metric.removesuffix("_mean")
    source: dict[int, dict[str, Any]] = {}
    if metric == explanation.metric:
        table = run.worst.filter(pc.equal(run.worst["metric"], metric))
        few = table.filter(pc.is_in(table["future"], pa.array(explanation.worst, table["future"].type)))
        source = {row["future"]: row for row in few.to_pylist()}
    pair = pair_of(explanation.metric)
    if explanation.metric == COLLISION or pair:
        hits = (
            first_contacts(run.collisions).sort_by([("time_s", "descending")]).to_pylist()
        )  # first one stays
        hits = [hit for hit in hits if not pair or {hit["track_id"], hit["other_id"]} == set(pair)]
        source = {hit["future"]: hit | {"timestamp_ms": MOMENT_MS + 1000 * hit["time_s"]} for hit in hits}
    values, rows = metric_values(run, explanation.metric), []
    for rank, future in enumerate(explanation.worst, 1):
        by = source.get(future, {})
        stamp = by.get("timestamp_ms")
        drivers = zip(track_ids, levels[future], strict=True)
        rows.append(
            {
                "metric": explanation.metric,
                "rank": rank,
                "future": future,
                "value": None if np.isnan(values[future]) else float(values[future]),
                "track_id": by.get("track_id"),
                "other_id": by.get("other_id"),
                "after_s": None if stamp is None else (stamp - MOMENT_MS) / 1000,
                "assignment": " ".join(f"{t}={names[m]}" for t, m in drivers),
            }
        )
    return rows
