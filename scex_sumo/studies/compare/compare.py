"""Compare runs by the densities of their metrics: by the values, and by how often they are defined.

Axes are R (run), C (future), M (metric). Formulas: docs/compare.md.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, get_args

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import InputError, ResultError, UsageError
from scex_sumo.results.design import column_of
from scex_sumo.results.run import Run
from scex_sumo.statistics.density import BANDWIDTH, density

Kind: TypeAlias = Literal["w1", "jsd"]

KINDS: Final[tuple[str, ...]] = get_args(Kind)
FEW_FUTURES: Final = 30

Columns: TypeAlias = Sequence[FloatArray]
"""One metric in all runs: R arrays (C,), NaN in the futures where it is undefined; inf is a value."""

SPREAD: Final = (0.1, 0.9)  # pooled quantiles between which the middle of all values lies
FENCE: Final = 1.0  # spreads beyond those quantiles at which a value no longer moves a distance

_LARGEST = 1e300  # larger values count as this one: differences stay finite


@dataclass(frozen=True, kw_only=True)
class Scale:
    """Unit of one metric, from the values of all runs together.

    Attributes:
        unit: 1 of distance, in the metric's unit; positive.
        middle: pooled median; stands for undefined values.
        low: lower values count as this one.
        high: higher values, also inf, count as this one.
    """

    unit: float
    middle: float
    low: float
    high: float

    def place(self, column: FloatArray) -> FloatArray:
        """Return values (C,) within the fences in units of the scale; undefined ones lie at the middle."""
        known = np.where(np.isnan(column), self.middle, column)
        return (np.clip(known, self.low, self.high) - self.middle) / self.unit


def pooled_scale(columns: Columns) -> Scale:
    """Return the scale of a metric from the finite values of all runs, each run with the same weight.

    The unit is the width of the middle 80 % of the values. The fences lie one unit beyond it.
    """
    finite = [np.clip(column[np.isfinite(column)], -_LARGEST, _LARGEST) for column in columns]
    pool = np.concatenate(finite)
    if pool.size == 0:
        return Scale(unit=1.0, middle=0.0, low=-1.0, high=1.0)
    weight = np.concatenate([np.full(v.size, 1 / v.size) for v in finite if v.size])
    low, middle, high = _quantiles(pool, weight, (SPREAD[0], 0.5, SPREAD[1]))
    if low == high:
        low, high = float(pool.min()), float(pool.max())
    unit = high - low if high > low else 1.0
    return Scale(unit=unit, middle=middle, low=low - FENCE * unit, high=high + FENCE * unit)


def wasserstein_distances(columns: Columns, scale: Scale) -> FloatArray:
    """Return the Wasserstein-1 distances (R, R) of one metric in units of its scale.

    Every future counts, so the triangle inequality holds.
    """
    placed = [np.sort(scale.place(column)) for column in columns]
    at = np.unique(np.concatenate(placed))
    shares = np.stack([np.searchsorted(p, at, side="right") / p.size for p in placed])
    width = np.diff(at)
    areas = np.zeros((len(placed), len(placed)))
    for r in range(len(placed) - 1):
        areas[r, r + 1 :] = np.abs(shares[r + 1 :, :-1] - shares[r, :-1]) @ width
    return areas + areas.T


def jensen_shannon_distances(columns: Columns, bandwidth: float = BANDWIDTH) -> FloatArray:
    """Return the square roots (R, R) of the Jensen-Shannon divergences (base 2) of one metric.

    0 for equal, 1 for disjoint densities. Undefined and infinite values are classes of their own.

    Source: Endres and Schindelin 2003.
    """
    finite = [column[np.isfinite(column)] for column in columns]
    pool = np.concatenate(finite)
    grid = density(pool, bandwidth).x if pool.size else np.empty(0)
    masses = np.zeros((len(columns), grid.size + 3))
    for row, column, values in zip(masses, columns, finite, strict=True):
        if values.size:
            heights = density(values, bandwidth, x=grid).pdf
            row[: grid.size] = heights / heights.sum() * (values.size / column.size)
        classes = (np.isnan(column), column == np.inf, column == -np.inf)
        row[grid.size :] = [np.count_nonzero(which) / column.size for which in classes]
    entropy = _entropy(masses)
    divergence = np.zeros((len(columns), len(columns)))
    for r in range(len(columns) - 1):
        others = masses[r + 1 :]
        divergence[r, r + 1 :] = _entropy((others + masses[r]) / 2) - (entropy[r + 1 :] + entropy[r]) / 2
    # Differences of entropies leave 1e-16 where nothing differs, and its root would be 1e-8.
    divergence = np.where(divergence < 1e-14, 0.0, np.minimum(divergence, 1.0))
    return np.asarray(np.sqrt(divergence + divergence.T))


def _quantiles(values: FloatArray, weight: FloatArray, levels: Sequence[float]) -> list[float]:
    # Runs given in another order must find the same value, and sums in another order round differently.
    at, group = np.unique(values, return_inverse=True)
    share = np.cumsum(np.bincount(group, weight)) / weight.sum()
    return [float(at[min(int(np.searchsorted(share, q - 1e-9)), at.size - 1)]) for q in levels]


def _entropy(masses: FloatArray) -> FloatArray:
    logarithm = np.log2(masses, where=masses > 0, out=np.zeros_like(masses))
    return np.asarray(-np.sum(masses * logarithm, axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Distances between R runs in M metrics.

    Attributes:
        values: (R, R, M) distance of the values.
        undefined: (R, R, M) difference of the defined shares; 0 for ``jsd``.
        noise: (R,) distance by chance of two runs of the same seed scene.
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

    @property
    def unit(self) -> str:
        """Unit of the distances, in words."""
        if self.kind == "w1":
            return "1: shifted by the range of the middle 80 % of all values"
        return "root of the Jensen-Shannon divergence, from 0 to 1"

    @property
    def chance(self) -> float:
        """Typical distance of two runs of one seed scene; NaN if no run has two futures."""
        return float("nan") if np.isnan(self.noise).all() else float(np.nanmedian(self.noise))

    def nearest(self, run: int) -> IntArray:
        """Return the other runs (R - 1,), the most similar first; equals by name."""
        others = np.array([r for r in range(len(self.labels)) if r != run], dtype=np.int64)
        names = np.array([self.labels[r] for r in others])
        return others[np.lexsort((names, self.total[run, others]))]

    def apart(self, first: int, second: int) -> list[tuple[str, float]]:
        """Return the metrics with the distances of two runs in them, the largest first."""
        distances = self.per_metric[first, second]
        return [(self.metrics[m], float(distances[m])) for m in np.argsort(-distances, kind="stable")]


def compare(runs: Sequence[Run], labels: Sequence[str], *, distance: str = "w1") -> Comparison:
    """Compute distances between the densities of at least two runs, as `compare_samples`."""
    comparable(runs, labels)
    samples = {m: [column_of(run.metrics, m) for run in runs] for m in runs[0].columns}
    return compare_samples(samples, labels, distance=distance)


def comparable(runs: Sequence[Run], labels: Sequence[str]) -> list[str]:
    """Check that runs have the same length and metrics; return notes on other differences."""
    if len(runs) < 2:
        raise UsageError(f"a comparison needs at least two runs, got {len(runs)}; name another result folder")
    first = runs[0]
    for label, run in zip(labels, runs, strict=True):
        for what, mine, other in (
            ("steps per future", run.info["steps"], first.info["steps"]),
            ("metrics", ", ".join(sorted(run.columns)), ", ".join(sorted(first.columns))),
            ("metric preset", run.info.get("preset", "paper"), first.info.get("preset", "paper")),
        ):
            if mine != other:
                raise ResultError(
                    f"{label}: {what} {mine}, but {labels[0]} has {other}; "
                    "they must be equal for a comparison; run one of them again"
                )
    notes = []
    for what, key in (("behaviour models", "models"), ("fixed models", "assign"), ("replan", "replan")):
        differing = [n for n, run in zip(labels, runs, strict=True) if run.info[key] != first.info[key]]
        if differing:
            notes.append(
                f"{what} of {_listing(differing)} are not those of {labels[0]}; distances show that too"
            )
    few = [label for label, run in zip(labels, runs, strict=True) if run.futures < FEW_FUTURES]
    if few:
        notes.append(f"fewer than {FEW_FUTURES} futures in {_listing(few)}; expect distances by chance alone")
    return notes


def compare_samples(
    samples: Mapping[str, Columns], labels: Sequence[str], *, distance: str = "w1"
) -> Comparison:
    """Compute distances between runs from their metric values, in scales that come from all runs.

    Args:
        samples: per metric R arrays (C,), NaN if undefined.
        distance: ``w1``: Wasserstein-1 over the pooled scale, plus the difference of the defined shares;
            ``jsd``: square root of the Jensen-Shannon divergence of the densities.
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
        raise InputError("a run without futures cannot be compared")
    if kind == "jsd":
        values = jensen_shannon_distances(columns)
        return values, np.zeros_like(values)
    defined = np.array([np.mean(~np.isnan(column)) for column in columns])
    return wasserstein_distances(columns, scale), np.abs(defined[:, None] - defined)


def _noise(samples: Mapping[str, Columns], scales: Sequence[Scale], kind: Kind) -> FloatArray:
    runs = len(next(iter(samples.values())))
    noise = np.zeros((runs, len(samples)))
    for m, (columns, scale) in enumerate(zip(samples.values(), scales, strict=True)):
        for r, column in enumerate(columns):
            noise[r, m] = np.nan  # one future says nothing about chance
            if column.size > 1:
                # Neighbouring futures may belong together in a balanced design: halves at random.
                halves = np.array_split(np.random.default_rng(0).permutation(column), 2)
                values, undefined = _distances(halves, scale, kind)
                noise[r, m] = values[0, 1] + undefined[0, 1]
    return np.asarray(noise.mean(axis=1) / np.sqrt(2))


def _listing(names: Sequence[str], most: int = 4) -> str:
    return ", ".join(names[:most]) + (f", ... ({len(names)} in all)" if len(names) > most else "")


@dataclass(frozen=True, kw_only=True, eq=False)
class Grouping:
    """Groups of R runs and the tree that they were cut from.

    Attributes:
        linkage: (R - 1, 4) as in scipy: the two parts joined, height in units of the distance, size.
        order: (R,) the runs as leaves of the tree.
        group: (R,) number of each run's group, from 1 on in the order of the leaves.
        silhouette: (R,) see `silhouette`.
    """

    linkage: FloatArray
    order: IntArray
    group: IntArray
    silhouette: FloatArray

    @property
    def groups(self) -> int:
        """Number of groups."""
        return int(self.group.max())


def group_runs(distance: FloatArray, labels: Sequence[str], *, groups: int | None = None) -> Grouping:
    """Cluster runs by Ward's criterion, in any order of the runs.

    It needs squared Euclidean distances: areas between distributions, whose root is one.

    Args:
        distance: (R, R) symmetric, 0 on the diagonal.
        labels: (R,) different names; they break ties.
        groups: 1 to R; default: from 2 to R - 1, by the largest mean silhouette.
    """
    from scipy.cluster.hierarchy import fcluster, leaves_list, linkage
    from scipy.spatial.distance import squareform

    count = len(labels)
    if groups is not None and not 1 <= groups <= count:
        raise UsageError(f"--groups: got {groups}, needs 1 to {count}, the number of runs")
    by_name = np.argsort(np.asarray(labels), kind="stable")
    condensed = squareform(distance[np.ix_(by_name, by_name)], checks=False)
    tree = linkage(np.sqrt(condensed), method="ward", optimal_ordering=True)
    tree[:, 2] **= 2
    leaves = np.asarray(leaves_list(tree), dtype=np.int64)
    choices = range(2, max(count, 3)) if groups is None else (groups,)
    best: tuple[float, IntArray, FloatArray] | None = None
    for choice in choices:
        group = np.empty(count, dtype=np.int64)
        group[by_name] = _numbered(np.asarray(fcluster(tree, choice, criterion="maxclust")), leaves)
        fit = silhouette(distance, group.tolist())
        # A later choice must be better by more than rounding.
        if best is None or fit.mean() > best[0] + 1e-12:
            best = (float(fit.mean()), group, fit)
    assert best is not None
    joined = tree[:, :2]
    joined[joined < count] = by_name[joined[joined < count].astype(np.int64)]
    return Grouping(linkage=tree, order=by_name[leaves], group=best[1], silhouette=best[2])


def _numbered(group: IntArray, leaves: IntArray) -> IntArray:
    names: dict[int, int] = {}
    for leaf in leaves:
        names.setdefault(int(group[leaf]), len(names) + 1)
    return np.array([names[int(g)] for g in group], dtype=np.int64)


def silhouette(distance: FloatArray, groups: Sequence[Hashable]) -> FloatArray:
    """Return the silhouette (R,) of each run, -1 to 1; 0 for a run alone in its group.

    (b - a) / max(a, b) with the mean distances a in its group and b to the nearest other group.

    Source: Rousseeuw 1987.
    """
    member = np.array([[g == name for g in groups] for name in dict.fromkeys(groups)])
    sizes = member.sum(axis=1)
    if len(sizes) < 2:
        return np.zeros(len(groups))
    sums = distance @ member.T
    own = member.argmax(axis=0)
    rows = np.arange(len(groups))
    within = sums[rows, own] / np.maximum(sizes[own] - 1, 1)
    mean = sums / sizes
    mean[rows, own] = np.inf
    between = mean.min(axis=1)
    larger = np.maximum(within, between)
    fit = np.divide(between - within, larger, where=larger > 0, out=np.zeros(len(groups)))
    return np.where(sizes[own] > 1, fit, 0.0)


def distances_table(comparison: Comparison) -> pa.Table:
    """Return one row for each pair and metric, and one for each pair with metric ``all``."""
    i, j = np.triu_indices(len(comparison.labels), 1)
    names = np.asarray(comparison.labels)
    parts = []
    for m, metric in [(None, "all"), *enumerate(comparison.metrics)]:
        terms = [comparison.values, comparison.undefined]
        values, undefined = [t.mean(axis=2) if m is None else t[:, :, m] for t in terms]
        apart = {"distance": values + undefined, "values": values, "undefined": undefined}
        named = {"first": names[i], "second": names[j], "metric": [metric] * len(i)}
        parts.append(pa.table(named | {name: each[i, j] for name, each in apart.items()}))
    return pa.concat_tables(parts)
