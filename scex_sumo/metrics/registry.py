"""Metrics by name: built-in ones, those of users and other packages, and sets of them.

A metric is a formula with its name, unit, threshold and rule of aggregation.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.base.importing import Registry, import_object
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.formulas.crossing import gap_time, pet
from scex_sumo.metrics.formulas.distance import distance, gap, least_gap
from scex_sumo.metrics.formulas.following import drac, pttc, pttc_path, thw, ttc, ttc_path
from scex_sumo.metrics.formulas.tq import tq
from scex_sumo.metrics.formulas.wttc import least_wttc, least_wttc_path, wttc, wttc_path
from scex_sumo.metrics.pairs.scenes import Entries, Samples, Scenes


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One nanoscopic metric and its aggregation.

    Attributes:
        evaluate: computes the values of all pairs (or vehicles) of a batch of scenes.
    """

    name: str
    critical: Literal["min", "max"]  # ``min`` if small values are critical, else ``max``
    evaluate: Callable[[Scenes], Samples | Entries]
    unit: str = ""
    inverse: bool = False  # aggregate 1 / value; ``critical``, ``threshold`` and ``label`` refer to it
    finite: bool = False  # leave infinite values out of the aggregates
    harmonic: bool = False  # the mean over scenes is 1 / mean(1 / value); infinite values count as 0
    quick: Callable[[Scenes], Samples | Entries] | None = None  # computes the same extrema from fewer pairs
    pairwise: bool = False  # a pair's values depend on its own two tracks only
    threshold: float | None = None  # value from which a future is critical
    label: str = ""  # name in tables and pictures; else the column's

    @property
    def columns(self) -> tuple[str, str]:
        """Columns of the most critical value and of the mean over scenes."""
        return self.name, f"{self.name}_mean"

    @property
    def side(self) -> Literal["left", "right"]:
        """Critical side of the threshold."""
        return "left" if self.critical == "min" else "right"

    @property
    def sign(self) -> Literal["≤", "≥"]:
        """Sign before the threshold in words."""
        return "≤" if self.critical == "min" else "≥"

    @property
    def words(self) -> str:
        """Name in tables and pictures."""
        return self.label or self.name

    @property
    def column_unit(self) -> str:
        """Unit of the columns; empty for none."""
        return f"1/{self.unit}" if self.inverse and self.unit else self.unit

    def titled(self) -> str:
        """Return name and unit, as ``gap time [s]``."""
        return f"{self.words} [{self.column_unit}]" if self.column_unit else self.words

    def description(self) -> dict[str, Any]:
        """Return the attributes as JSON, with the formula's import path and its file's SHA-256."""
        attributes = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in _CODE}
        function = inspect.unwrap(self.evaluate)
        place = f"{getattr(function, '__module__', '')}:{getattr(function, '__qualname__', '')}"
        try:
            code = Path(inspect.getfile(function)).read_bytes()
        except (OSError, TypeError):  # an interpreter's function, or none of Python
            return {**attributes, "function": place, "sha256": None}
        return {**attributes, "function": place, "sha256": hashlib.sha256(code).hexdigest()}

    @classmethod
    def described(cls, description: Mapping[str, Any]) -> Metric:
        """Build from a description a metric without its formula."""
        names = [f.name for f in dataclasses.fields(cls) if f.name not in _CODE]
        return cls(evaluate=_no_formula, **{name: description[name] for name in names if name in description})


_CODE = ("evaluate", "quick")  # functions


def _no_formula(scenes: Scenes) -> Samples | Entries:
    raise UsageError("metrics: this metric is known from a result only; register its function to evaluate it")


def _of(name: str, unit: str, side: Any, formula: Any, label: str = "", **more: Any) -> Metric:
    return Metric(name=name, unit=unit, critical=side, evaluate=formula, label=label, **more)


_TTC, _PET, _DRAC = (EVENTS[name].threshold for name in ("ttc", "pet", "drac"))
_INVERSE_TTC: Final[dict[str, Any]] = {"inverse": True, "threshold": 1 / _TTC}
_BY_HEADING = (
    _of("distance", "m", "min", distance, pairwise=True, threshold=5.0),
    _of("tq", "", "max", tq, "traffic quality", threshold=1.2),
    _of("gap_time", "s", "min", gap_time, "gap time"),
    _of("pttc", "s", "min", pttc, "PTTC", finite=True, harmonic=True),
    _of("wttc", "s", "min", wttc, "WTTC", quick=least_wttc, pairwise=True, threshold=0.26),
    _of("ttc", "s", "max", ttc, "1/TTC", **_INVERSE_TTC),
)
_ON_PATHS = (
    _of("gap", "m", "min", gap, "body gap", quick=least_gap, pairwise=True),
    _of("ttc_path", "s", "max", ttc_path, "1/TTC on path", **_INVERSE_TTC),
    _of("pttc_path", "s", "min", pttc_path, "PTTC on path", finite=True, harmonic=True),
    _of("wttc_path", "s", "min", wttc_path, "WTTC of outlines", quick=least_wttc_path, pairwise=True),
    _of("thw", "s", "min", thw, "THW"),
    _of("drac", "m/s²", "max", drac, "DRAC", threshold=_DRAC),
    _of("pet", "s", "min", pet, "PET", threshold=_PET),
)
METRICS: Final[Mapping[str, Metric]] = {metric.name: metric for metric in (*_BY_HEADING, *_ON_PATHS)}
"""Built-in metrics: the paper's six, and those along paths."""

_OF_CONFLICTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "needed_braking": {"unit": "m/s²", "side": "max", "label": "needed braking", "threshold": _DRAC},
    "time_margin": {"unit": "s", "side": "min", "label": "time margin", "threshold": _PET},
}
"""Metrics of any two that meet, without their formulas, which only a run that asks for them loads."""

OURS: Final[tuple[str, ...]] = (*METRICS, *_OF_CONFLICTS)
"""Names of all built-in metrics."""

PAPER_METRICS: Final[tuple[str, ...]] = tuple(metric.name for metric in _BY_HEADING)
BOTH: Final = "both"
SETS: Final[Mapping[str, tuple[str | Metric, ...]]] = {
    "paper": _BY_HEADING,
    "path": _ON_PATHS,
    BOTH: (*_BY_HEADING, *_ON_PATHS),
    "conflicts": tuple(_OF_CONFLICTS),
}
"""Metrics that a word stands for."""

COLUMNS: Final[tuple[str, ...]] = tuple(c for name in PAPER_METRICS for c in METRICS[name].columns)
"""The paper's twelve columns of a future; ``ttc`` and ``ttc_mean`` are in 1/s."""

THRESHOLDS: Final[Mapping[str, float]] = {
    metric.name: metric.threshold for metric in _BY_HEADING if metric.threshold is not None
}
"""The paper's thresholds by column."""

PACKAGES: Final = Registry(group="scex_sumo.metrics", kind="metric")
COLLISION: Final = "collision"
"""Column that is no metric: 1 if two vehicles of a future collide, else 0."""

# sets, and other columns of tables
TAKEN: Final = (*SETS, "future", "case_id", COLLISION, "all")

_registered: dict[str, Metric] = {}
_COLLISIONS = {COLLISION: Metric.described({"name": COLLISION, "critical": "max", "threshold": 1.0})}


def known_metrics() -> tuple[str, ...]:
    """Return the names of all metrics."""
    return (*OURS, *sorted({*_registered, *PACKAGES.paths}))


def metrics_named(names: Iterable[str | Metric] | None) -> tuple[Metric, ...]:
    """Return metrics by name or import path, each once; None stands for ``paper``."""
    wanted: list[str | Metric] = []
    for name in ("paper",) if names is None else names:
        wanted += SETS[name] if isinstance(name, str) and name in SETS else [name]
    metrics = {m.name: m for m in (n if isinstance(n, Metric) else _metric(n) for n in wanted)}
    if not metrics:
        raise UsageError("metrics: none is named; choose paper, path or single ones, e.g. ttc,wttc")
    return tuple(metrics.values())


def metrics_asked(given: str | Iterable[str | Metric]) -> tuple[Metric, ...]:
    """Return the metrics of a list of names and sets, also as the text of an option."""
    return metrics_named([name.strip() for name in given.split(",")] if isinstance(given, str) else given)


def _metric(name: str) -> Metric:
    if (known := _known(name)) is not None:
        return known
    paths = PACKAGES.paths
    if ":" not in name and name not in paths:
        raise UsageError(f"{_unknown(name)}; a metric of your own is MODULE:FUNCTION")
    metric = getattr(import_object(paths.get(name, name)), "__scex_metric__", None)
    if not isinstance(metric, Metric):
        raise UsageError(f"metrics: {name} is no metric; decorate it with @scex_sumo.metric(...)")
    return metric


def _known(name: str, own: Mapping[str, Metric] = MappingProxyType({})) -> Metric | None:
    """Return the metric of a name that is built in, of a result's ``own``, or registered; else None."""
    if name in _OF_CONFLICTS:
        from scex_sumo.metrics.formulas import conflicts

        return _of(name, formula=getattr(conflicts, name), pairwise=True, **_OF_CONFLICTS[name])
    return next((known[name] for known in (METRICS, own, _registered) if name in known), None)


def _unknown(name: str) -> str:
    return f"metrics: unknown metric {name[:40]!r}; nearest: {nearest(name[:40], known_metrics())}"


def column_named(text: str, columns: Iterable[str] = COLUMNS) -> str:
    """Return the column of a name, in any case; raise a `UsageError` with the nearest ones if none has it."""
    known = {column.lower(): column for column in columns}
    if text.lower() not in known:
        raise UsageError(f"unknown metric {text[:40]!r}; nearest: {nearest(text[:40], known.values())}")
    return known[text.lower()]


def columns_of(metrics: Sequence[Metric]) -> tuple[str, ...]:
    """Return the columns of a future."""
    return tuple(column for metric in metrics for column in metric.columns)


def thresholds_of(metrics: Iterable[Metric]) -> dict[str, float]:
    """Return thresholds by column."""
    return {metric.name: metric.threshold for metric in metrics if metric.threshold is not None}


def metric_of(column: str, own: Mapping[str, Metric] = MappingProxyType({})) -> Metric:
    """Return the metric of a result column, e.g. of ``ttc_mean``; a result describes its ``own``."""
    name = column.removesuffix("_mean")
    metric = _known(name, {**_COLLISIONS, **own})
    if metric is None:  # column names are data of others and never imported
        raise UsageError(_unknown(name))
    return metric


def critical_columns(columns: Iterable[str]) -> list[str]:
    """Select the columns of most critical values."""
    return [column for column in columns if not column.endswith("_mean")]


def describe_metrics(metrics: Sequence[Metric]) -> list[dict[str, Any]]:
    """Describe metrics for ``run.json``; nothing for the usual sets."""
    if tuple(metrics) in (SETS["paper"], SETS["path"], SETS[BOTH]):
        return []
    return [metric.description() for metric in metrics]


def described_metrics(descriptions: Iterable[Mapping[str, Any]]) -> dict[str, Metric]:
    """Return by name the metrics of ``run.json``, whose functions this process may not have."""
    own = [description for description in descriptions if description["name"] not in TAKEN]
    return {description["name"]: Metric.described(description) for description in own}
