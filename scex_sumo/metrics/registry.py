"""Metrics by name: built-in ones, those of users and other packages, and sets of them.

A metric is a formula with its name, unit, threshold and rule of aggregation.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

from scex_sumo.base.errors import UsageError, nearest
from scex_sumo.base.importing import Registry, import_object
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.formulas.conflicts import needed_braking, time_margin
from scex_sumo.metrics.formulas.crossing import gap_time, pet
from scex_sumo.metrics.formulas.distance import distance, gap, least_distance, least_gap
from scex_sumo.metrics.formulas.following import drac, least_pttc, least_ttc, pttc, thw, ttc
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
    preset: str | None = None  # car-following rule; None uses that of the evaluation
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

    def titled(self, without: str = "") -> str:
        """Return name and unit, as ``gap time [s]``; ``without`` replaces a missing unit."""
        unit = self.column_unit or without
        return f"{self.words} [{unit}]" if unit else self.words

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


_PTTC = Metric(
    name="pttc",
    unit="s",
    critical="min",
    evaluate=pttc,
    quick=least_pttc,
    finite=True,
    harmonic=True,
    label="PTTC",
)
_TTC = Metric(
    name="ttc",
    unit="s",
    critical="max",
    evaluate=ttc,
    quick=least_ttc,
    inverse=True,
    threshold=1 / 1.5,
    label="1/TTC",
)
_BY_HEADING = (
    Metric(
        name="distance",
        unit="m",
        critical="min",
        evaluate=distance,
        quick=least_distance,
        pairwise=True,
        threshold=5.0,
    ),
    Metric(name="tq", critical="max", evaluate=tq, quick=tq, threshold=1.2, label="traffic quality"),
    Metric(name="gap_time", unit="s", critical="min", evaluate=gap_time, quick=gap_time, label="gap time"),
    _PTTC,
    Metric(
        name="wttc",
        unit="s",
        critical="min",
        evaluate=wttc,
        quick=least_wttc,
        pairwise=True,
        threshold=0.26,
        label="WTTC",
    ),
    _TTC,
)
_LIMITS = {name: event.threshold for name, event in EVENTS.items()}
_ON_PATHS = (
    Metric(
        name="gap",
        unit="m",
        critical="min",
        evaluate=gap,
        quick=least_gap,
        pairwise=True,
        label="body gap",
    ),
    replace(
        _TTC,
        name="ttc_path",
        preset="path",
        threshold=1 / _LIMITS["ttc"],
        label="1/TTC on path",
    ),
    replace(_PTTC, name="pttc_path", preset="path", label="PTTC on path"),
    Metric(
        name="wttc_path",
        unit="s",
        critical="min",
        evaluate=wttc_path,
        quick=least_wttc_path,
        pairwise=True,
        label="WTTC of outlines",
    ),
    Metric(name="thw", unit="s", critical="min", evaluate=thw, label="THW"),
    Metric(
        name="drac",
        unit="m/s²",
        critical="max",
        evaluate=drac,
        threshold=_LIMITS["drac"],
        label="DRAC",
    ),
    Metric(
        name="pet", unit="s", critical="min", evaluate=pet, quick=pet, threshold=_LIMITS["pet"], label="PET"
    ),
)
_OF_CONFLICTS = (
    Metric(
        name="needed_braking",
        unit="m/s²",
        critical="max",
        evaluate=needed_braking,
        pairwise=True,
        threshold=_LIMITS["drac"],
        label="needed braking",
    ),
    Metric(
        name="time_margin",
        unit="s",
        critical="min",
        evaluate=time_margin,
        pairwise=True,
        threshold=_LIMITS["pet"],
        label="time margin",
    ),
)
METRICS: Final[Mapping[str, Metric]] = {
    each.name: each for each in (*_BY_HEADING, *_ON_PATHS, *_OF_CONFLICTS)
}
"""Built-in metrics: the paper's six, those of preset ``path``, those of any two that meet."""

PAPER_METRICS: Final[tuple[str, ...]] = tuple(each.name for each in _BY_HEADING)
SETS: Final[Mapping[str, tuple[Metric, ...]]] = {
    "paper": _BY_HEADING,
    "path": tuple(replace(each, preset="path", quick=each.quick or each.evaluate) for each in _ON_PATHS),
    "conflicts": _OF_CONFLICTS,
}
"""Metrics that a word stands for; those of ``path`` are always evaluated along paths."""

COLUMNS: Final[tuple[str, ...]] = tuple(c for name in PAPER_METRICS for c in METRICS[name].columns)
"""The paper's twelve columns of a future; ``ttc`` and ``ttc_mean`` are in 1/s."""

THRESHOLDS: Final[Mapping[str, float]] = {
    each.name: each.threshold for each in _BY_HEADING if each.threshold is not None
}
"""The paper's thresholds by column."""

PACKAGES: Final = Registry(group="scex_sumo.metrics", kind="metric")
COLLISION: Final = "collision"
"""Column that is no metric: 1 if two vehicles of a future collide, else 0."""

BOTH: Final = "both"
"""Word for the paper's metrics and those along paths."""

# sets, and other columns of tables
_TAKEN: Final = (*SETS, BOTH, "future", "case_id", COLLISION, "all")

_registered: dict[str, Metric] = {}
_COLLISIONS = {COLLISION: Metric.described({"name": COLLISION, "critical": "max", "threshold": 1.0})}


def known_metrics() -> tuple[str, ...]:
    """Return the names of all metrics."""
    return (*METRICS, *sorted({*_registered, *PACKAGES.paths}))


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
    names = [name.strip() for name in given.split(",")] if isinstance(given, str) else given
    return metrics_named(one for name in names for one in (("paper", "path") if name == BOTH else (name,)))


def rule_of(metrics: Iterable[Metric]) -> str:
    """Return the car-following rule of metrics that leave it open: ``path`` with those along paths alone."""
    names = {metric.name for metric in metrics}
    along = {metric.name for metric in SETS["path"]}
    return "path" if along <= names and not names & set(PAPER_METRICS) else "paper"


def _metric(name: str) -> Metric:
    here = {**METRICS, **_registered}
    if name in here:
        return here[name]
    printed = {_plain(word): own for own in here.values() for word in (own.name, own.words)}
    if _plain(name) in printed:
        return printed[_plain(name)]
    paths = PACKAGES.paths
    if ":" not in name and name not in paths:
        raise UsageError(f"{_unknown(name)}; a metric of your own is MODULE:FUNCTION")
    made = getattr(import_object(paths.get(name, name), own=True), "__scex_metric__", None)
    if not isinstance(made, Metric):
        raise UsageError(f"metrics: {name} is no metric; decorate it with @scex_sumo.metric(...)")
    return made


def _unknown(name: str) -> str:
    return f"metrics: unknown metric {name[:40]!r}; nearest: {nearest(name[:40], known_metrics())}"


def _plain(text: str) -> str:
    return text.partition("[")[0].strip().lower().replace("-", " ").replace("_", " ")


def column_named(
    text: str, columns: Iterable[str] = COLUMNS, own: Mapping[str, Metric] = MappingProxyType({})
) -> str:
    """Find a column by its name as printed, in any case: ``TTC``, ``1/TTC``, ``mean TTC``.

    ``own`` metrics as of `metric_of`.
    """
    columns = tuple(columns)
    if text in columns:
        return text
    spelled: dict[str, str] = {}
    for column in columns:
        words = _plain(metric_of(column, own).words)
        inverted = words.removeprefix("1/")  # the table says 1/TTC
        if column.endswith("_mean"):
            for said in (inverted, words):
                spelled |= dict.fromkeys((f"{said} mean", f"mean {said}"), column)
            spelled[f"mean {_plain(column.removesuffix('_mean'))}"] = column
        else:
            spelled |= dict.fromkeys((inverted, words), column)
        spelled[_plain(column)] = column
    if _plain(text) not in spelled:
        raise UsageError(f"unknown metric {text[:40]!r}; nearest: {nearest(text[:40], columns)}")
    return spelled[_plain(text)]


def columns_of(metrics: Sequence[Metric]) -> tuple[str, ...]:
    """Return the columns of a future."""
    return tuple(column for each in metrics for column in each.columns)


def thresholds_of(metrics: Iterable[Metric]) -> dict[str, float]:
    """Return thresholds by column."""
    return {each.name: each.threshold for each in metrics if each.threshold is not None}


def metric_of(column: str, own: Mapping[str, Metric] = MappingProxyType({})) -> Metric:
    """Return the metric of a result column, e.g. of ``ttc_mean``; a result describes its ``own``."""
    name = column.removesuffix("_mean")
    for metrics in (METRICS, own, _registered, _COLLISIONS):
        if name in metrics:
            return metrics[name]
    # Column names are data of others and never imported.
    raise UsageError(_unknown(name))


def critical_columns(columns: Iterable[str]) -> list[str]:
    """Select the columns of most critical values."""
    return [column for column in columns if not column.endswith("_mean")]


def describe_metrics(metrics: Sequence[Metric]) -> list[dict[str, Any]]:
    """Describe metrics for ``run.json``; nothing for the presets' sets."""
    if tuple(metrics) in (SETS["paper"], SETS["path"], (*SETS["paper"], *SETS["path"])):
        return []
    return [each.description() for each in metrics]


def described_metrics(descriptions: Iterable[Mapping[str, Any]]) -> dict[str, Metric]:
    """Return by name the metrics of ``run.json``, whose functions this process may not have."""
    return {each["name"]: Metric.described(each) for each in descriptions if each["name"] not in _TAKEN}
