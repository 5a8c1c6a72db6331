"""Explain criticality: which vehicles' models make the values vary, and what makes them critical."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import Interval
from scex_sumo.studies.explain.effects import Condition, Effect, beyond_chance, conditions, covering, effects

WORST_SHARE: Final = 0.1
"""The most critical tenth stands in for the critical children of a metric without threshold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Explanation of one metric.

    Attributes:
        defined: number of children in which it is defined.
        effects: see `effects`; empty where nothing can be said.
        threshold: of criticality; the limit of the most critical tenth where the metric has none.
        given: whether the threshold is the run's.
        p_critical: critical share of all children.
        conditions: more critical than the scene overall, see `beyond_chance`.
        rules: a few conditions that account for much of what is critical, see `covering`.
        worst: most critical children, the worst first.
    """

    metric: str
    defined: int
    effects: list[Effect]
    threshold: float
    given: bool
    p_critical: Interval
    conditions: list[Condition]
    rules: list[Condition]
    worst: list[int]


RULES: Final = 3
MOMENT_MS: Final = 1000  # the seed scene is frame 10 of every child


def explain(
    run: Run, metrics: Sequence[str], *, worst: int = 5, progress: Callable[[int, int], None] | None = None
) -> list[Explanation]:
    """Explain metrics of a finished run.

    Args:
        metrics: metric columns, ``collision``, or two track ids ``A,B``: whether these two collide.
        worst: how many of the most critical children are named.
        progress: called with (steps done, steps in all).
    """
    from scex_sumo.metrics.registry import column_named

    names = [m if pair_of(m) else column_named(m, [*run.outcomes, *run.columns]) for m in metrics]
    values, (levels, _) = [metric_values(run, name) for name in names], assignment_of(run)
    tick, count = progress or (lambda done, total: None), len(names)
    found = effects(
        levels, np.stack(values, axis=1), lambda done, total: tick(count * done // total, 2 * count)
    )
    explanations = []
    for number, (name, one) in enumerate(zip(names, values, strict=True)):
        explanations.append(_explain(run, name, one, levels, found[number], worst))
        tick(count + number + 1, 2 * count)
    return explanations


def _explain(
    run: Run, metric: str, values: FloatArray, levels: IntArray, found: list[Effect], worst: int
) -> Explanation:
    from scex_sumo.metrics.registry import side_of

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
    intervals = run.intervals
    share = intervals.share(critical)
    pairs = meeting(run)
    every = conditions(levels, critical, pairs=pairs, intervals=intervals)
    order = np.lexsort((np.arange(len(values)), np.where(known, sign * values, np.inf)))
    return Explanation(
        metric=metric,
        defined=int(known.sum()),
        effects=found,
        threshold=limit,
        given=given,
        p_critical=share,
        conditions=beyond_chance(every, share.value),
        rules=covering(levels, critical, RULES, every, pairs=pairs),
        worst=[int(c) for c in order[: min(worst, int(known.sum()))]],
    )


def meeting(run: Run) -> set[tuple[int, int]]:
    """Pairs of vehicles, as indices, that meet in some child; others make nothing critical together."""
    place = {track: index for index, track in enumerate(run.info["seed_scene"]["track_ids"])}
    rows = zip(run.encounters["track_id"].to_pylist(), run.encounters["other_id"].to_pylist(), strict=True)
    pairs = (sorted((place[one], place[two])) for one, two in rows)
    return {(one, two) for one, two in pairs}


def pair_of(metric: str) -> tuple[int, int] | None:
    """The two vehicles that ``A,B`` names; None for a metric."""
    ids = [part.strip() for part in metric.split(",")]
    if len(ids) != 2 or not all(part.isdecimal() for part in ids):
        return None
    return int(ids[0]), int(ids[1])


def metric_values(run: Run, metric: str) -> FloatArray:
    """(C,) values to be explained; for two vehicles 1 in children in which they collide, else 0.

    Raises:
        UsageError: there is no such metric, or the two collide in no child.
    """
    pair = pair_of(metric)
    if pair is None:
        return run.values(metric)
    table = run.collisions
    one, two = np.asarray(table["track_id"]), np.asarray(table["other_id"])
    both = np.isin(one, pair) & np.isin(two, pair) & (one != two)
    if not both.any():
        raise UsageError(f"{metric}: these two collide in no child; see scex-sumo encounters {run.folder}")
    return np.isin(np.asarray(run.metrics["child"]), np.asarray(table["child"])[both]).astype(np.float64)


def assignment_of(run: Run) -> tuple[IntArray, list[str]]:
    """(C, V) model of each vehicle in each child, vehicles as in the seed scene, and the models' names."""
    table = run.assignments
    names, flat = np.unique(np.asarray(table["model"].to_pylist(), dtype=str), return_inverse=True)
    vehicles = int(run.info["seed_scene"]["vehicles"])
    return flat.reshape(-1, vehicles).astype(np.int64), [str(n) for n in names]


def effect_rows(explanation: Explanation, track_ids: Sequence[int]) -> list[dict[str, Any]]:
    """Effects as rows of a table."""
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
    """Conditions as rows of a table."""
    return [
        {
            "metric": explanation.metric,
            "track_id": track_ids[c.vehicles[0]],
            "model": names[c.models[0]],
            "other_id": track_ids[c.vehicles[1]] if len(c.vehicles) > 1 else None,
            "other_model": names[c.models[1]] if len(c.vehicles) > 1 else None,
            "children": c.children,
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
    """The most critical children as rows; ``levels`` and ``names`` as of `assignment_of`."""
    track_ids = run.info["seed_scene"]["track_ids"]
    metric = explanation.metric.removesuffix("_mean")
    source = {
        row["child"]: row
        for row in (run.worst.to_pylist() if metric == explanation.metric else [])
        if row["metric"] == metric and row["child"] in explanation.worst
    }
    pair = pair_of(explanation.metric)
    if explanation.metric == COLLISION or pair:
        hits = run.collisions.sort_by([("time_s", "descending")]).to_pylist()  # the first of a child stays
        hits = [hit for hit in hits if not pair or {hit["track_id"], hit["other_id"]} == set(pair)]
        source = {hit["child"]: hit | {"timestamp_ms": MOMENT_MS + 1000 * hit["time_s"]} for hit in hits}
    values, rows = metric_values(run, explanation.metric), []
    for rank, child in enumerate(explanation.worst, 1):
        by = source.get(child, {})
        stamp = by.get("timestamp_ms")
        drivers = zip(track_ids, levels[child], strict=True)
        rows.append(
            {
                "metric": explanation.metric,
                "rank": rank,
                "child": child,
                "value": None if np.isnan(values[child]) else float(values[child]),
                "track_id": by.get("track_id"),
                "other_id": by.get("other_id"),
                "after_s": None if stamp is None else (stamp - MOMENT_MS) / 1000,
                "assignment": " ".join(f"{t}={names[m]}" for t, m in drivers),
            }
        )
    return rows
