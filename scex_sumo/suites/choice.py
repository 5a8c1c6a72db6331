"""Choice of cases: a stratified draw, kind by kind, with known probabilities whose inverses are the weights.

Each kind has at least one case, if there are enough. A kind has cases in proportion to its candidates and to
people's contacts in them, and so has a candidate within its kind. Weighted sums over the cases estimate sums
over all candidates without bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.suites.population import Population

LEAST: Final = 2
"""Least number of cases: one has no variance."""
EVEN: Final = 0.7
"""Part of the draw by number of encounters; the other part is by people's P."""
_HALVINGS = 100
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Chosen candidates, (n,) each, kind by kind, those with the largest P of people first.

    Attributes:
        index: into the population.
        chance: probability of being drawn.
    """

    index: IntArray
    chance: FloatArray

    def __len__(self) -> int:
        return len(self.index)


def check_count(count: int) -> None:
    """Raise a `UsageError` for a number of cases of which no variance is known."""
    if count < LEAST:
        raise UsageError(f"--count: got {count}, needs at least {LEAST}")


def choose(population: Population, count: int, *, seed: int = 0) -> Chosen:
    """Draw candidates, at least one of each kind if ``count`` suffices for that; all if there are no more.

    Systematic sampling: the chances of all candidates in a row, ordered by kind and P of people, are cut at
    equal steps. So each kind has its expected number of cases or the next one, and cases of high and low P.
    """
    check_count(count)
    chance = chances(population, count)
    order = np.lexsort((-population.column("probability"), population.kind))
    steps = np.concatenate([[0.0], np.cumsum(chance[order])]) + np.random.default_rng(seed).random()
    index = order[np.diff(np.floor(steps + _ROUNDING)) > 0]
    return Chosen(index=index, chance=chance[index])


def chances(population: Population, count: int) -> FloatArray:
    """Return the probability (N,) with which each candidate becomes one of ``count`` cases."""
    share = population.column("share")
    contacts = share * population.column("probability")
    size = EVEN * share / share.sum() + (1 - EVEN) * contacts / contacts.sum()
    _, kind = np.unique(population.kind, return_inverse=True)
    held, sizes = np.bincount(kind), np.bincount(kind, size)
    cases = between(sizes, min(1.0, count / len(held)), held, min(count, len(size)))
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
