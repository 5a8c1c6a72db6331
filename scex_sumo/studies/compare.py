"""Comparison of runs: how far seed scenes are apart, judged by the densities of their metrics.

Per metric, two runs differ by where their values lie (``values``) and by how often the metric is defined at
all (``undefined``); the distance of two runs is the mean over the metrics of the sum of both. Axes are named
R (run), M (metric), C (child). Formulas: docs/compare.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.errors import InputError, ResultError, UsageError
from scex_sumo.statistics.distances import (
    Columns,
    Scale,
    jensen_shannon_distances,
    pooled_scale,
    wasserstein_distances,
)

if TYPE_CHECKING:
    from scex_sumo.results.run import Run

Kind: TypeAlias = Literal["w1", "jsd"]

KINDS: Final[tuple[str, ...]] = get_args(Kind)
FEW_CHILDREN: Final = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Distances between runs.

    Attributes:
        kind: ``w1`` or ``jsd``.
        labels: (R,) names of the runs.
        metrics: (M,) metric columns.
        scales: (M,) what the values were measured with.
        values: (R, R, M) how far apart the values are.
        undefined: (R, R, M) how far apart the shares of children are in which the metric is defined; 0 for
            ``jsd``, whose divergence counts undefined children itself.
        noise: (R,) distance that two runs of the same seed scene with as many children have by chance.
    """

    kind: Kind
    labels: tuple[str, ...]
    metrics: tuple[str, ...]
    scales: tuple[Scale, ...]
    values: FloatArray
    undefined: FloatArray
    noise: FloatArray

    @property
    def per_metric(self) -> FloatArray:
        """(R, R, M) distance in each metric."""
        return self.values + self.undefined

    @property
    def total(self) -> FloatArray:
        """(R, R) distance of the runs: the mean over all metrics."""
        return np.asarray(self.per_metric.mean(axis=2))

    def nearest(self, run: int) -> IntArray:
        """(R - 1,) all other runs, the most similar first; of equally similar ones by name."""
        others = np.array([r for r in range(len(self.labels)) if r != run], dtype=np.int64)
        names = np.array([self.labels[r] for r in others])
        return others[np.lexsort((names, self.total[run, others]))]

    def apart(self, first: int, second: int) -> list[tuple[str, float]]:
        """Metrics that set two runs apart with their distances, the one that does most first."""
        distances = self.per_metric[first, second]
        return [(self.metrics[m], float(distances[m])) for m in np.argsort(-distances, kind="stable")]


def compare(runs: Sequence[Run], *, labels: Sequence[str] | None = None, distance: str = "w1") -> Comparison:
    """Distances between the densities of runs.

    The scales come from the runs compared, so a distance between two runs depends on the company they are in.

    Args:
        runs: at least two, with the same metric columns.
        labels: (R,) names; by default those of the seed scenes.
        distance: ``w1``: Wasserstein-1 of the samples over the pooled scale, plus the difference of the
            defined shares; ``jsd``: square root of the Jensen-Shannon divergence of the densities, with
            undefined and infinite values as classes of their own.

    Raises:
        UsageError: fewer than two runs, or an unknown distance.
        ResultError: runs that cannot be compared, see :func:`comparable`.
    """
    names = [str(run.info["seed_scene"]["name"]) for run in runs] if labels is None else list(labels)
    comparable(runs, names)
    samples = {
        m: [np.asarray(r.metrics[m].to_numpy(zero_copy_only=False), dtype=np.float64) for r in runs]
        for m in runs[0].columns
    }
    return compare_samples(samples, names, distance=distance)


def comparable(runs: Sequence[Run], labels: Sequence[str]) -> list[str]:
    """Whether runs can be compared: same length, same metrics.

    A longer child has worse extrema whatever the place, and metrics of another preset are other quantities:
    such runs are refused. Other drivers, another replanning interval or fewer children may be what the user
    wants to compare; that they differ is said.

    Returns:
        What the reader should know of the differences, one sentence each.

    Raises:
        UsageError: fewer than two runs.
        ResultError: they differ in steps, metric columns or preset.
    """
    if len(runs) < 2:
        raise UsageError(f"a comparison needs at least two runs, got {len(runs)}; name another result folder")
    first = runs[0]
    for label, run in zip(labels, runs, strict=True):
        for what, mine, other in (
            ("steps per child", run.info["steps"], first.info["steps"]),
            ("metrics", ", ".join(sorted(run.columns)), ", ".join(sorted(first.columns))),
            ("metric preset", run.info.get("preset", "paper"), first.info.get("preset", "paper")),
        ):
            if mine != other:
                raise ResultError(
                    f"{label}: {what} {mine}, but {labels[0]} has {other}; "
                    "only runs alike in this can be compared, run one of them again"
                )
    notes = []
    for what, key in (("behaviour models", "models"), ("fixed models", "assign"), ("replan", "replan")):
        differing = [n for n, run in zip(labels, runs, strict=True) if run.info[key] != first.info[key]]
        if differing:
            notes.append(
                f"{what} of {_listing(differing)} are not those of {labels[0]}; distances show that too"
            )
    few = [label for label, run in zip(labels, runs, strict=True) if run.children < FEW_CHILDREN]
    if few:
        notes.append(
            f"fewer than {FEW_CHILDREN} children in {_listing(few)}; expect distances by chance alone"
        )
    return notes


def compare_samples(
    samples: Mapping[str, Columns], labels: Sequence[str], *, distance: str = "w1"
) -> Comparison:
    """Distances between runs from their metric values.

    Args:
        samples: per metric R arrays (C,), NaN where undefined; C may differ between runs.
        distance: ``w1`` or ``jsd``, as in :func:`compare`.

    Raises:
        UsageError: an unknown distance.
        InputError: a run without children.
    """
    if distance not in KINDS:
        raise UsageError(f"unknown distance {distance!r}; known: {', '.join(KINDS)}")
    kind: Kind = "jsd" if distance == "jsd" else "w1"
    scales = tuple(pooled_scale(columns) for columns in samples.values())
    parts = [_distances(c, s, kind) for c, s in zip(samples.values(), scales, strict=True)]
    return Comparison(
        kind=kind,
        labels=tuple(labels),
        metrics=tuple(samples),
        scales=scales,
        values=np.stack([values for values, _ in parts], axis=2),
        undefined=np.stack([undefined for _, undefined in parts], axis=2),
        noise=_noise(samples, scales, kind),
    )


def _distances(columns: Columns, scale: Scale, kind: Kind) -> tuple[FloatArray, FloatArray]:
    if any(column.size == 0 for column in columns):
        raise InputError("a run without children cannot be compared")
    if kind == "jsd":
        values = jensen_shannon_distances(columns)
        return values, np.zeros_like(values)
    defined = np.array([np.mean(~np.isnan(column)) for column in columns])
    return wasserstein_distances(columns, scale), np.abs(defined[:, None] - defined)


def _noise(samples: Mapping[str, Columns], scales: Sequence[Scale], kind: Kind) -> FloatArray:
    """(R,) distance of two random halves of each run's children, over the root of 2.

    The distance between samples of one density falls with the root of their number, and the halves are half
    as large as the runs are.
    """
    runs = len(next(iter(samples.values())))
    noise = np.zeros((runs, len(samples)))
    for m, (columns, scale) in enumerate(zip(samples.values(), scales, strict=True)):
        for r, column in enumerate(columns):
            if column.size > 1:
                # Neighbouring children may belong together in a balanced design: halves at random.
                halves = np.array_split(np.random.default_rng(0).permutation(column), 2)
                values, undefined = _distances(halves, scale, kind)
                noise[r, m] = values[0, 1] + undefined[0, 1]
            else:
                noise[r, m] = np.nan  # one child says nothing about chance
    return np.asarray(noise.mean(axis=1) / np.sqrt(2))


def _listing(names: Sequence[str], most: int = 4) -> str:
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")
