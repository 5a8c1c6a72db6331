"""Choice of cases: one weighted draw, with strata by kind, and at least one case of each.

Candidates are drawn one after the other along a line on which each has a length, its probability to be drawn
(systematic sampling, Madow 1949). On the line kinds follow each other, and within a kind candidates are in
the order of P. So each kind has its share of the cases, all classes of risk occur, and a candidate's
probability is known; its inverse is its weight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import UsageError
from scex_sumo.suites.population import Population

LEAST: Final = 2
"""Least number of cases: one has no variance."""
EVEN: Final = 0.5
"""Part of the draw by number of encounters; the other part is by people's P."""


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """Chosen candidates, (n,) each, by kind and P.

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
    """Draw ``count`` candidates; all if there are no more."""
    check_count(count)
    chance = chances(population, min(count, len(population)))
    order = np.lexsort((-population.column("probability"), population.kind))
    start = np.random.default_rng(seed).random()
    steps = np.floor(np.concatenate([[0.0], np.cumsum(chance[order])]) + start + 1e-9)
    index = order[np.diff(steps) > 0]
    return Chosen(index=index, chance=chance[index])


def chances(population: Population, count: int) -> FloatArray:
    """Return the probability (N,) of each candidate to be drawn; with a sum of 1 or more in each kind.

    Where there are more kinds than cases, each has the same part of them.
    """
    size = sizes(population)
    kinds, kind = np.unique(population.kind, return_inverse=True)
    least = min(1.0, count / len(kinds))
    chance = _capped(size, count)
    for _ in range(len(kinds)):
        sums = np.bincount(kind, chance)
        short = sums < least - 1e-9
        if not short.any():
            break
        fixed = short | (np.abs(sums - least) < 1e-9)
        for k in np.flatnonzero(short):
            chance[kind == k] = _capped(size[kind == k], least)
        others = ~fixed[kind]
        chance[others] = _capped(size[others], count - least * int(fixed.sum()))
    return chance


def sizes(population: Population) -> FloatArray:
    """Return (N,) how likely candidates are drawn, in parts of all: by encounters, and by people's P."""
    share = population.column("share")
    contacts = share * population.column("probability")
    return np.asarray(EVEN * share / share.sum() + (1 - EVEN) * contacts / contacts.sum())


def _capped(size: FloatArray, count: float) -> FloatArray:
    """Return probabilities (N,) like the sizes, at most 1, with a sum of ``count``, or all 1."""
    chance = np.zeros(len(size))
    sure = np.zeros(len(size), dtype=np.bool_)
    while True:
        left = count - sure.sum()
        if left <= 0 or sure.all():
            return np.where(sure, 1.0, chance)
        chance = np.where(sure, 1.0, size / size[~sure].sum() * left)
        more = ~sure & (chance >= 1 - 1e-12)
        if not more.any():
            return chance
        sure |= more
