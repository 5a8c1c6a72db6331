"""Metrics by name: the built-in ones, those that a user registers, and the presets."""

from __future__ import annotations

import importlib.metadata
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal, TypeVar

from scex_sumo.errors import UsageError
from scex_sumo.importing import import_object
from scex_sumo.metrics.formulas.distance import distance
from scex_sumo.metrics.formulas.drac import drac
from scex_sumo.metrics.formulas.gap_time import gap_time
from scex_sumo.metrics.formulas.pet import pet
from scex_sumo.metrics.formulas.pttc import pttc
from scex_sumo.metrics.formulas.thw import thw
from scex_sumo.metrics.formulas.tq import tq
from scex_sumo.metrics.formulas.ttc import ttc
from scex_sumo.metrics.formulas.wttc import wttc
from scex_sumo.metrics.metric import Metric
from scex_sumo.metrics.outlines.wttc_path import least_wttc_path, wttc_path
from scex_sumo.metrics.pairs.entries import Entries
from scex_sumo.metrics.pairs.gap import gap, least_gap
from scex_sumo.metrics.pairs.scenes import Samples, Scenes

F = TypeVar("F", bound=Callable[[Scenes], Samples | Entries])

_BY_HEADING = (
    Metric(name="distance", unit="m", critical="min", evaluate=distance, threshold=5.0),
    Metric(name="tq", critical="max", evaluate=tq, threshold=1.2, label="traffic quality"),
    Metric(name="gap_time", unit="s", critical="min", evaluate=gap_time, label="gap time"),
    Metric(name="pttc", unit="s", critical="min", evaluate=pttc, finite=True, harmonic=True, label="PTTC"),
    Metric(name="wttc", unit="s", critical="min", evaluate=wttc, threshold=0.26, label="WTTC"),
    Metric(
        name="ttc",
        unit="s",
        critical="max",
        evaluate=ttc,
        inverse=True,
        threshold=1 / 1.5,
        label="1/TTC",
    ),
)
_ON_PATHS = (
    Metric(name="gap", unit="m", critical="min", evaluate=gap, quick=least_gap, label="body gap"),
    replace(_BY_HEADING[5], name="ttc_path", preset="path", label="1/TTC on path"),
    replace(_BY_HEADING[3], name="pttc_path", preset="path", label="PTTC on path"),
    Metric(
        name="wttc_path",
        unit="s",
        critical="min",
        evaluate=wttc_path,
        quick=least_wttc_path,
        label="WTTC of outlines",
    ),
    Metric(name="thw", unit="s", critical="min", evaluate=thw, label="THW"),
    Metric(name="drac", unit="m/s²", critical="max", evaluate=drac, threshold=3.4, label="DRAC"),
    Metric(name="pet", unit="s", critical="min", evaluate=pet, threshold=1.0, label="PET"),
)
METRICS: Final[Mapping[str, Metric]] = {each.name: each for each in (*_BY_HEADING, *_ON_PATHS)}
"""Built-in metrics; the first six are the paper's, the others those of preset ``path``, in their order."""

PAPER_METRICS: Final[tuple[str, ...]] = tuple(each.name for each in _BY_HEADING)
SETS: Final[Mapping[str, tuple[Metric, ...]]] = {
    "paper": _BY_HEADING,
    "path": tuple(replace(each, preset="path") for each in _ON_PATHS),
}
"""Metrics that a word stands for; those of ``path`` are evaluated along paths whatever the others are."""

COLUMNS: Final[tuple[str, ...]] = tuple(c for name in PAPER_METRICS for c in METRICS[name].columns)
"""The paper's twelve columns of a child scenario; ``ttc`` and ``ttc_mean`` are in 1/s."""

THRESHOLDS: Final[Mapping[str, float]] = {
    each.name: each.threshold for each in _BY_HEADING if each.threshold is not None
}
"""Thresholds that the paper suggests, by column."""

ENTRY_POINTS: Final = "scex_sumo.metrics"
_TAKEN: Final = (
    *SETS,
    "both",
    "child",
    "case_id",
    "collision",
    "all",
)  # sets, and other columns of the tables

_registered: dict[str, Metric] = {}
COLLISION: Final = "collision"
"""Column of what is no metric: 1 where two vehicles of a child collide, else 0."""

_described: dict[str, Metric] = {  # what results have columns of without a function here
    COLLISION: Metric.described({"name": COLLISION, "critical": "max", "threshold": 1.0})
}


def metric(
    name: str,
    *,
    critical: Literal["min", "max"],
    unit: str = "",
    threshold: float | None = None,
    label: str | None = None,
    inverse: bool = False,
    finite: bool = False,
) -> Callable[[F], F]:
    """Register a function of `Scenes` that returns `Samples` as a metric: ``@metric("my_metric", ...)``.

    Args:
        name: of the column.
        critical: ``min`` where small values are critical, ``max`` where large ones are.
        unit: of the function's values.
        threshold: from which value on a child is critical; None for none.
        label: name in tables and pictures.
        inverse: aggregated as 1 / value; ``critical`` and ``threshold`` refer to the inverse.
        finite: infinite values are left out of the aggregates.

    Raises:
        UsageError: the name is taken or cannot be written on a command line, or the side is unknown.
    """
    if name in METRICS or name in _TAKEN:
        raise UsageError(f"metric {name!r}: the name is taken; choose another one")
    if not name or name.endswith("_mean") or any(c in name for c in ",:@=. \t\n"):
        raise UsageError(f"metric {name!r}: a name has none of , : @ = . and no spaces, nor ends with _mean")
    if critical not in ("min", "max"):
        raise UsageError(f"metric {name!r}: critical={critical!r}; choose min or max")
    if threshold is not None and not math.isfinite(threshold):
        raise UsageError(f"metric {name!r}: threshold {threshold} is not a finite number")

    def register(function: F) -> F:
        made = Metric(
            name=name,
            unit=unit,
            critical=critical,
            evaluate=function,
            inverse=inverse,
            finite=finite,
            threshold=threshold,
            label=label or "",
        )
        _registered[name] = made
        function.__scex_metric__ = made  # type: ignore[attr-defined]
        return function

    return register


def known_metrics() -> tuple[str, ...]:
    """Names of the built-in metrics, the registered ones and those of other packages."""
    return (*METRICS, *sorted({*_registered, *_entry_points()}))


def metrics_named(names: Iterable[str | Metric] | None) -> tuple[Metric, ...]:
    """Metrics by name or import path, each once; ``paper``, and None, stand for the paper's six.

    ``path`` stands for those of preset ``path``, evaluated along paths whatever the preset is.

    Raises:
        UsageError: an unknown metric, or one that cannot be loaded.
    """
    wanted: list[str | Metric] = []
    for name in ("paper",) if names is None else names:
        wanted += SETS[name] if isinstance(name, str) and name in SETS else [name]
    found = {m.name: m for m in (n if isinstance(n, Metric) else _metric(n) for n in wanted)}
    if not found:
        raise UsageError(f"metrics: none is named; known: {', '.join(known_metrics())}")
    return tuple(found.values())


def _metric(name: str) -> Metric:
    if name in METRICS or name in _registered:
        return METRICS[name] if name in METRICS else _registered[name]
    points = _entry_points()
    printed = {_plain(word): own for own in (*METRICS, *_registered) for word in (own, _known(own).words)}
    if _plain(name) in printed:
        return _known(printed[_plain(name)])
    if ":" in name:
        made = import_object(name)
    elif name in points:
        try:
            made = points[name].load()
        except Exception as error:  # anything can go wrong in another package's import
            raise UsageError(f"metrics: {name}: entry point {points[name].value}: {error}") from error
    else:
        raise UsageError(f"metrics: unknown metric {name!r}; known: {', '.join(known_metrics())}")
    known = getattr(made, "__scex_metric__", None)
    if not isinstance(known, Metric):
        raise UsageError(f"metrics: {name} is no metric; decorate it with @scex_sumo.metric(...)")
    return known


def _known(name: str) -> Metric:
    return METRICS[name] if name in METRICS else _registered[name]


def _plain(text: str) -> str:
    """A metric as it may be written or printed, in one way: ``1/TTC [1/s]`` as ``1/ttc``."""
    return text.partition("[")[0].strip().lower().replace("-", " ").replace("_", " ")


def column_named(text: str, columns: Iterable[str] = COLUMNS) -> str:
    """The column that is meant by a name as it is printed, in any case: ``TTC``, ``1/TTC`` and ``ttc``.

    Args:
        text: name or label of a metric, of a mean with ``mean`` before or after it.
        columns: those there are.

    Raises:
        UsageError: none of them is meant.
    """
    columns = tuple(columns)
    if text in columns:
        return text
    spelled: dict[str, str] = {}
    for column in columns:
        words = _plain(metric_of(column).words)
        inverted = words.removeprefix("1/")  # the table says 1/TTC
        if column.endswith("_mean"):
            for said in (inverted, words):
                spelled |= dict.fromkeys((f"{said} mean", f"mean {said}"), column)
            spelled[f"mean {_plain(column.removesuffix('_mean'))}"] = column
        else:
            spelled |= dict.fromkeys((inverted, words), column)
        spelled[_plain(column)] = column
    if _plain(text) not in spelled:
        raise UsageError(f"unknown metric {text[:40]!r}; known: {', '.join(columns)}")
    return spelled[_plain(text)]


def _entry_points() -> dict[str, importlib.metadata.EntryPoint]:
    return {point.name: point for point in importlib.metadata.entry_points(group=ENTRY_POINTS)}


def columns_of(metrics: Sequence[Metric]) -> tuple[str, ...]:
    """Columns of a child scenario: per metric its most critical value and its mean over the scenes."""
    return tuple(column for each in metrics for column in each.columns)


def thresholds_of(metrics: Iterable[Metric]) -> dict[str, float]:
    """Thresholds by column, of the metrics that have one."""
    return {each.name: each.threshold for each in metrics if each.threshold is not None}


def metric_of(column: str) -> Metric:
    """The metric of a result column, e.g. of ``ttc_mean``.

    Raises:
        UsageError: no metric of that name is known in this process or was described by a result.
    """
    name = column.removesuffix("_mean")
    for known in (METRICS, _registered, _described):
        if name in known:
            return known[name]
    return _metric(name)


def critical_columns(columns: Iterable[str]) -> list[str]:
    """The columns of most critical values, without those of means."""
    return [column for column in columns if not column.endswith("_mean")]


def side_of(column: str) -> Literal["left", "right"]:
    """On which side of its threshold a metric column is critical."""
    return metric_of(column).side


def describe_metrics(metrics: Sequence[Metric]) -> list[dict[str, Any]]:
    """What ``run.json`` says of metrics, since they decide on the result; nothing of the sets of a preset."""
    if tuple(metrics) in (SETS["paper"], SETS["path"], (*SETS["paper"], *SETS["path"])):
        return []
    return [each.description() for each in metrics]


def learn_metrics(descriptions: Iterable[Mapping[str, Any]]) -> None:
    """Take in what ``run.json`` says of metrics, for columns whose functions this process may not have."""
    _described.update((each["name"], Metric.described(each)) for each in descriptions)
