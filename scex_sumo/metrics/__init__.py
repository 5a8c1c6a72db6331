"""Criticality metrics: nanoscopic values per pair, microscopic values per child."""

from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import COLUMNS, PairValues, ScenarioValues, evaluate, evaluate_pairs

__all__ = [
    "COLUMNS",
    "MetricParameters",
    "PairValues",
    "PlannedPaths",
    "ScenarioValues",
    "SceneTracks",
    "evaluate",
    "evaluate_pairs",
]
