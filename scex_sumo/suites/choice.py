"""Choice of cases: a stratified draw, kind by kind, with known probabilities whose inverses are the weights.

Each kind has at least one case, else cases in proportion to the sizes of its candidates. Weighted sums over
the cases estimate sums over all candidates without bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.suites.population import Population

EACH: Final = 2
"""Least cases of a stratum: one has no variance."""
_HALVINGS = 100
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Chosen:
    """Chosen candidates, (n,) each, kind by kind, those with the largest class of risk first.

    Attributes:
        index: into the population.
        stratum: number of it; ``strata`` has their words, ``sizes`` their numbers of candidates.
        weight: candidates for which a case stands.
    """

    index: IntArray
    stratum: IntArray
    weight: FloatArray
    strata: Sequence[str]
    sizes: IntArray

    def __len__(self) -> int:
        return len(self.index)


def check_count(count: int) -> None:
    """Raise a `UsageError` for a number of cases of which no variance is known."""
    if count < EACH:
        raise UsageError(f"--count: got {count}, needs at least {EACH}")


def choose(population: Population, count: int, *, seed: int = 0) -> Chosen:
    """Draw candidates by `Population.size`, at least one of each kind if ``count`` suffices for that.

    Systematic sampling (Madow 1949): the chances of all candidates in a row are cut at equal steps. The row
    is ordered by kind and class of risk, and random within. So each kind has its expected number of cases or
    the next one, of high and of low risk.

    Raises:
        UsageError: fewer than two cases.
    """
    check_count(count)
    rng, (names, kind) = np.random.default_rng(seed), np.unique(population.kinds, return_inverse=True)
    chance = chances(population, count)
    order = np.lexsort((rng.random(len(chance)), -population.risk, kind))
    steps = np.concatenate([[0.0], np.cumsum(chance[order])]) + rng.random()
    index = order[np.diff(np.floor(steps + _ROUNDING)) > 0]
    stratum, strata = _strata(kind, chance > 1 - _ROUNDING, index, names.tolist())
    return Chosen(
        index=index,
        stratum=stratum[index],
        weight=1 / chance[index],
        strata=strata,
        sizes=np.bincount(stratum, minlength=len(strata)),
    )


def chances(population: Population, count: int) -> FloatArray:
    """Return the probability (N,) with which each candidate becomes one of ``count`` cases."""
    size, (_, kind) = population.size(), np.unique(population.kinds, return_inverse=True)
    held, shares = np.bincount(kind), np.bincount(kind, size)
    cases = between(shares, min(1.0, count / len(held)), held, min(count, len(size)))
    chance = np.empty(len(size))
    for number, expected in enumerate(cases):
        chance[kind == number] = between(size[kind == number], 0.0, 1.0, expected)
    return chance


def between(shares: ArrayLike, least: ArrayLike, most: ArrayLike, total: float) -> FloatArray:
    """Return values (n,) in proportion to positive shares, within bounds, that sum to a total."""
    shares = np.asarray(shares, dtype=np.float64)
    low, high = 0.0, total / float(shares.min())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if np.clip(middle * shares, least, most).sum() < total else (low, middle)
    return np.asarray(np.clip(high * shares, least, most))


def _strata(
    kind: IntArray, sure: BoolArray, index: IntArray, names: Sequence[str]
) -> tuple[IntArray, list[str]]:
    """Return the stratum (N,) of candidates and the words of each stratum.

    The first one has what is taken for sure. Kinds with fewer than `EACH` other cases share the last one.
    """
    others = np.bincount(kind[~sure], minlength=len(names))
    drawn = np.bincount(kind[index[~sure[index]]], minlength=len(names))
    own = [name for name, cases in zip(names, drawn, strict=True) if cases >= EACH]
    few = [name for name, n, cases in zip(names, others, drawn, strict=True) if n > 0 and cases < EACH]
    number = np.array([own.index(name) if name in own else len(own) for name in names])
    strata = ["taken for sure", *own, *([", ".join(few)] if few else [])]
    return np.where(sure, 0, 1 + number[kind]), strata
