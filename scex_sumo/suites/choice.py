"""Choice of cases: strata of kind and risk, clusters in each, and one case drawn of each cluster.

What can bring about much is taken for sure. Clusters of the others have nearly one share of it and gather
round medoids in the space of standardised parameters. So the cases cover that space, and each candidate has a
known probability to be chosen, whose inverse is its weight: weighted sums over the cases estimate sums over
all candidates without bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.suites.population import RISK_WORDS, Population

EACH: Final = 2
"""Least cases of a stratum: one has no variance."""
_ROUNDS = 8  # of the medoids
_NAMED = 3  # kinds of a stratum in its words


@dataclass(frozen=True, kw_only=True, eq=False)
class Chosen:
    """Chosen candidates, (n,) each, in the order of what they add.

    Attributes:
        index: into the population.
        stratum: number of it; ``strata`` has their words, ``sizes`` their numbers of candidates.
        weight: candidates for which a case stands.
        spare: (n,) other candidates of the cluster, in random order.
        novelty: distance in standardised parameters to the nearest case before it; 1 for the first of a kind.
    """

    index: IntArray
    stratum: IntArray
    weight: FloatArray
    novelty: FloatArray
    spare: Sequence[Sequence[int]]
    strata: Sequence[str]
    sizes: IntArray

    def __len__(self) -> int:
        return len(self.index)


def check_count(count: int) -> None:
    """Raise a `UsageError` for a number of cases of which no variance is known."""
    if count < EACH:
        raise UsageError(f"--count: got {count}, needs at least {EACH}")


def choose(population: Population, count: int, *, seed: int = 0, per_moment: bool = True) -> Chosen:
    """Choose about ``count`` candidates; all if there are no more.

    Candidates with a large share of `Population.size` are taken for sure. Of the others, a cluster gives one,
    with a probability like its share.

    Args:
        per_moment: at most one candidate of a moment, as long as its cluster has another one.

    Raises:
        UsageError: fewer than two cases.
    """
    check_count(count)
    rng, features, size = np.random.default_rng(seed), population.parameters(), population.size()
    sure = _sure(size, min(count, len(population)))
    stratum, shares = _divided(population, size, sure, count - int(sure.sum()))
    words = ["taken for sure", *_words(np.array(population.kinds), population.risk, stratum)]
    sizes = np.rint(np.bincount(stratum, population.stands_for, minlength=len(words))).astype(np.int64)
    index: list[int] = np.flatnonzero(sure).tolist()
    weight, spare = [1.0] * len(index), [list[int]() for _ in index]  # among the rows
    seeds = [row["seed"] for row in population.rows]
    used = {seeds[k] for k in index}
    for h, cases in enumerate(shares.tolist(), start=1):
        inside = np.flatnonzero(stratum == h)
        cluster = clusters(features[inside], size[inside], cases, rng)
        for c in range(cases):
            members = inside[cluster == c]
            share = size[members] / size[members].sum()
            order = rng.choice(members, len(members), replace=False, p=share).tolist()
            free = [k for k in order if not per_moment or seeds[k] not in used]
            index.append((free or order)[0])
            weight.append(float(size[members].sum() / size[index[-1]]))
            spare.append([k for k in order if k != index[-1]])
            used.add(seeds[index[-1]])
    chosen = np.array(index, dtype=np.int64)
    order, novelty = _by_novelty(features[chosen], np.array(population.kinds)[chosen])
    return Chosen(
        index=chosen[order],
        stratum=stratum[chosen][order],
        weight=(np.array(weight) * population.stands_for[chosen])[order],
        novelty=novelty,
        spare=[spare[k] for k in order.tolist()],
        strata=words,
        sizes=sizes,
    )


def _divided(
    population: Population, size: FloatArray, sure: BoolArray, count: int
) -> tuple[IntArray, IntArray]:
    """Return the stratum (N,) of candidates, 0 of those taken for sure, and the cases (H,) of the others."""
    rest, kinds = np.flatnonzero(~sure), np.array(population.kinds)
    stratum = np.zeros(len(population), dtype=np.int64)
    if not len(rest):
        return stratum, stratum[:0]
    mixed = strata_of(population, rest, max(1, count // (2 * EACH)))
    own, shared = own_strata(kinds[rest], mixed, size[rest], count, served=kinds[sure])
    stratum[rest] = own + 1
    held, sums = np.bincount(own), np.bincount(own, size[rest]).astype(np.float64)
    least = np.where(np.arange(len(held)) < shared, EACH, 1)
    return stratum, allocation(held, sums, count, least=least)


def _sure(size: FloatArray, count: int) -> BoolArray:
    """Return which of (N,) candidates are taken for sure: their share of ``count`` would be one or more.

    `EACH` cases are left to the others, if there are any.
    """
    sure = np.zeros(len(size), dtype=np.bool_)
    while True:
        left = count - int(sure.sum())
        more = ~sure & (size * left >= size[~sure].sum() * (1 - 1e-9)) if left > 0 else np.zeros_like(sure)
        if not more.any():
            break
        sure |= more
    if not sure.all():
        sure[np.argsort(np.where(sure, -size, 0.0), kind="stable")[max(0, count - EACH) :]] = False
    return sure


def strata_of(population: Population, some: IntArray, most: int) -> IntArray:
    """Return the stratum (n,) of some candidates: kinds by class of risk.

    The smallest of more than ``most`` strata joins the smallest of its kind, else that of its risk.
    """
    kinds, risk = np.array(population.kinds)[some].tolist(), population.risk[some].tolist()
    groups: dict[frozenset[tuple[str, int]], int] = {}
    for cell in zip(kinds, risk, strict=True):
        groups[frozenset([cell])] = groups.get(frozenset([cell]), 0) + 1
    least = max(EACH, len(some) // (4 * most))
    while len(groups) > 1:
        small = min(groups, key=lambda g: (groups[g], sorted(g)))
        if len(groups) <= most and groups[small] >= least:
            break
        others = sorted(
            (g for g in groups if g != small), key=lambda g: (_apart(small, g), groups[g], sorted(g))
        )
        groups[small | others[0]] = groups.pop(small) + groups.pop(others[0])
    names = sorted(groups, key=lambda g: (-groups[g], sorted(g)))
    number = {cell: h for h, group in enumerate(names) for cell in group}
    return np.array([number[cell] for cell in zip(kinds, risk, strict=True)], dtype=np.int64)


def own_strata(
    kinds: NDArray[np.str_], stratum: IntArray, size: FloatArray, count: int, *, served: NDArray[np.str_]
) -> tuple[IntArray, int]:
    """Return strata (n,) in which each kind has one of its own, and the number of those that were before.

    A kind that shares all its strata gets its part of the one in which it weighs most; the heaviest kinds
    first, if ``count`` cases are too few for all.

    Args:
        served: kinds that have a case already.
    """
    strata, lacking = stratum.copy(), dict[str, FloatArray]()
    alone = {kinds[stratum == h][0] for h in np.unique(stratum) if len(set(kinds[stratum == h])) == 1}
    for kind in sorted(set(kinds) - set(served) - alone):
        lacking[kind] = np.bincount(stratum, size * (kinds == kind)).astype(np.float64)
    room = count - EACH * len(np.unique(stratum))
    for kind in sorted(lacking, key=lambda kind: -lacking[kind].sum())[: max(room, 0)]:
        strata[(kinds == kind) & (stratum == np.argmax(lacking[kind]))] = strata.max() + 1
    left, number = np.unique(strata, return_inverse=True)
    return number, int((left <= stratum.max()).sum())


def _apart(one: frozenset[tuple[str, int]], other: frozenset[tuple[str, int]]) -> tuple[int, int]:
    """Return how badly two strata fit: by their classes of risk, then whether they have no kind in common."""
    risks = [[risk for _, risk in group] for group in (one, other)]
    away = abs(max(risks[0]) - max(risks[1]))
    same = bool({kind for kind, _ in one} & {kind for kind, _ in other})
    return away, 0 if same else 1


def _words(kinds: NDArray[np.str_], risk: IntArray, stratum: IntArray) -> list[str]:
    """Return the words of the strata of candidates (n,), from 1 on."""
    words = []
    for h in range(1, int(stratum.max(initial=0)) + 1):
        own, risks = np.unique(kinds[stratum == h]), np.unique(risk[stratum == h])
        name = ", ".join(own) if len(own) <= _NAMED else f"{len(own)} kinds"
        words.append(f"{name}, {' or '.join(RISK_WORDS[k] for k in risks)}")
    return words


def allocation(sizes: IntArray, sums: FloatArray, count: int, *, least: IntArray) -> IntArray:
    """Return the number of cases (H,) of each stratum: ``least``, or all; the others by the sum of shares."""
    counts = np.minimum(sizes, least).astype(np.float64)
    for _ in range(len(sizes) + 1):
        open_ = counts < sizes
        left = min(count, int(sizes.sum())) - counts.sum()
        if left <= 1e-9 or not open_.any():
            break
        counts = np.minimum(counts + left * _share(np.where(open_, sums, 0.0)), sizes)
    whole = np.floor(counts + 1e-9).astype(np.int64)
    rest = np.argsort(whole - counts, kind="stable")[: max(0, round(float(counts.sum())) - int(whole.sum()))]
    whole[rest] += 1
    return np.minimum(whole, sizes)


def _share(values: FloatArray) -> FloatArray:
    total = float(values.sum())
    return np.asarray(values / total if total > 0 else np.full(len(values), 1 / max(len(values), 1)))


def clusters(features: FloatArray, size: FloatArray, count: int, rng: np.random.Generator) -> IntArray:
    """Return the cluster (N,) of each point: medoids, with clusters of nearly one sum of sizes.

    Args:
        features: (N, D); ``size`` (N,).
        count: at most N.
    """
    if count <= 1:
        return np.zeros(len(features), dtype=np.int64)
    medoid = [int(rng.integers(len(features)))]
    far = np.linalg.norm(features - features[medoid[0]], axis=1)
    while len(medoid) < count:
        square = far**2
        total = float(square.sum())
        free = np.setdiff1d(np.arange(len(features)), medoid)
        new = int(rng.choice(len(features), p=square / total)) if total > 0 else int(free[0])
        medoid.append(new)
        far = np.minimum(far, np.linalg.norm(features - features[new], axis=1))
    centre = features[medoid]
    for _ in range(_ROUNDS):
        cluster = _balanced(features, size, centre)
        middle = np.stack([features[cluster == c].mean(axis=0) for c in range(count)])
        nearest = [
            np.flatnonzero(cluster == c)[
                np.argmin(np.linalg.norm(features[cluster == c] - middle[c], axis=1))
            ]
            for c in range(count)
        ]
        if np.array_equal(features[nearest], centre):
            break
        centre = features[nearest]
    return cluster


def _balanced(features: FloatArray, size: FloatArray, centre: FloatArray) -> IntArray:
    """Assign points (N, D) to near centres (K, D), with nearly the same sum of sizes; none is empty."""
    count = len(centre)
    apart = np.linalg.norm(features[:, None] - centre, axis=2)
    room = np.full(count, size.sum() / count)
    cluster = np.full(len(features), -1, dtype=np.int64)
    cluster[np.argmin(apart, axis=0)] = np.arange(count)
    second = np.partition(apart, 1, axis=1)[:, 1]
    for k in np.argsort(apart.min(axis=1) - second, kind="stable").tolist():  # the surest first
        if cluster[k] < 0:
            fits = np.flatnonzero(room >= size[k] / 2)
            near = fits if len(fits) else np.array([int(np.argmax(room))])
            cluster[k] = near[np.argmin(apart[k, near])]
        room[cluster[k]] -= size[k]
    for c in np.setdiff1d(np.arange(count), cluster).tolist():  # centres that share a point
        largest = int(np.argmax(np.bincount(cluster, minlength=count)))
        cluster[np.flatnonzero(cluster == largest)[0]] = c
    return cluster


def _by_novelty(features: FloatArray, kinds: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return an order (n,) in which each case is the farthest from those before it, and that distance.

    Cases of different kinds are at least 1 apart.
    """
    apart = np.linalg.norm(features[:, None] - features, axis=2)
    apart = np.where(kinds[:, None] == kinds, apart, np.maximum(apart, 1.0))
    order = [int(np.argmin(apart.sum(axis=1)))]
    novelty, near = [1.0], apart[order[0]].copy()
    near[order[0]] = -1.0
    while len(order) < len(features):
        order.append(int(np.argmax(near)))
        novelty.append(float(near[order[-1]]))
        near = np.minimum(near, apart[order[-1]])
        near[order] = -1.0
    return np.array(order, dtype=np.int64), np.array(novelty)
