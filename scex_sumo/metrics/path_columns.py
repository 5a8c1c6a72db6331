"""Columns of preset ``path`` under names of their own, beside the paper's twelve."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Final, Literal

from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import PAPER, ScenarioValues, evaluate
from scex_sumo.metrics.outlines.least import least_gap, least_wttc_path
from scex_sumo.metrics.registry import METRICS

PATH_METRICS: Final[tuple[str, ...]] = ("gap", "ttc_path", "pttc_path", "wttc_path", "thw", "drac", "pet")
PATH_COLUMNS: Final[tuple[str, ...]] = tuple(c for name in PATH_METRICS for c in (name, f"{name}_mean"))
"""The fourteen columns of a child; ``ttc_path`` and ``ttc_path_mean`` are in 1/s."""

PATH_THRESHOLDS: Final[Mapping[str, float]] = {"ttc_path": 1 / 1.5, "pet": 1.0, "drac": 3.4}
"""Critical values: 1/s, s, m/s²."""

PATH_SIDES: Final[Mapping[str, Literal["left", "right"]]] = {
    name: "right" if name in ("ttc_path", "drac") else "left" for name in PATH_METRICS
}
"""On which side of its threshold a metric is critical."""

_FROM = {"ttc_path": "ttc", "pttc_path": "pttc"}


def evaluate_path(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    *,
    parameters: MetricParameters = PAPER,
    vehicles: Collection[int] | None = None,
) -> ScenarioValues:
    """Metrics of preset ``path`` of every child.

    Args:
        tracks: what the vehicles did; steps before ``tracks.first`` are history.
        planned: their planned paths; what needs leaders is undefined without.
        parameters: constants.
        vehicles: values are of pairs that involve one of these (indices); None: all.

    Returns:
        Values in the order of ``PATH_COLUMNS``.
    """
    metrics = [METRICS[_FROM.get(name, name)] for name in PATH_METRICS]
    if vehicles is None:  # only the pairs that can be a scene's extremum are looked at closely
        quick = {"gap": least_gap, "wttc_path": least_wttc_path}
        metrics = [replace(m, evaluate=quick[m.name]) if m.name in quick else m for m in metrics]
    found = evaluate(
        tracks, planned, preset="path", parameters=parameters, metrics=metrics, vehicles=vehicles
    )
    names = {_FROM.get(name, name): name for name in PATH_METRICS}
    return replace(
        found,
        columns=PATH_COLUMNS,
        scene={names[key]: value for key, value in found.scene.items()},
        worst={names[key]: value for key, value in found.worst.items()},
    )
