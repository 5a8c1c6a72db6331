"""Keyword arguments of `extrapolate`, for editors and type checkers; tests compare them with the options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypedDict

from scex_sumo.extrapolation.settings import Driver, Models
from scex_sumo.metrics.registry import Metric
from scex_sumo.results.region import Region


class RunKeywords(TypedDict, total=False):
    """Options of a run, all optional; see `RunSettings` and `RunOptions`."""

    futures: int | str
    steps: int
    replan: int
    models: Models
    assign: Mapping[int, Driver]
    under_test: Mapping[int, Driver | None]
    region: Region | str | int | None
    metrics: str | Sequence[str | Metric]
    thresholds: Mapping[str, float]
    seed: int
    world: str
    vru: str
    rules: bool
    workers: int | str | None
    gui: bool
    extra: Sequence[Any]
    overwrite: bool
    out: str | Path | None
    cache: bool
    reference: str | None
    report: bool
