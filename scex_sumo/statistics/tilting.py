"""Tilted draws of random variables: proposals of importance sampling, and the weights of their futures.

Each vehicle of a future has one number in [0, 1), from which a model derives all its random variables. A
proposal draws this number by rejection, so that some variables are likely extreme. A tilted future is thus a
future like any other one, with a known likelihood ratio.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtr

from scex_sumo.base.arrays import FloatArray, IntArray

EDGES: Final = np.arange(-2.5, 2.51, 0.5)
"""Edges of the classes of a variable, as normal scores."""

MAX_RATIO: Final = 3000.0
"""Largest likelihood ratio of one vehicle: so many numbers are drawn for one that is kept."""

MAX_TILT: Final = 2.5
_CANDIDATES = 1 << 16  # numbers at once, at most


@dataclass(frozen=True, kw_only=True, eq=False)
class Variables:
    """Random variables of a vehicle: K classified variables, independent of each other.

    Attributes:
        prior: (K, B) probabilities of the classes.
        score: (K, B) values of the classes, with mean 0 and variance 1; 0 where a variable is constant.
        classes: function that returns the class (n,) of a variable for numbers (n,).
        words: (K, 2) what low and high scores mean; empty where nothing is to be said.
        inattentive: variables that depend on each other, of which a high class means an inattentive driver; a
            proposal tilts at most one.
    """

    words: tuple[tuple[str, str], ...]
    prior: FloatArray
    score: FloatArray
    classes: Callable[[FloatArray, int], IntArray]
    inattentive: tuple[int, ...] = ()

    def scores(self, draw: FloatArray) -> FloatArray:
        """Return the scores (n, K) of numbers (n,)."""
        return np.stack([self.score[k][self.classes(draw, k)] for k in range(len(self.prior))], axis=1)

    def tilted(self, mean: FloatArray) -> FloatArray:
        """Return likelihood ratios (K, B) of classes, so that the scores have means (K,).

        The ratio is exp(θ·score) / E[exp(θ·score)]. Means are lowered if the product of the largest ratios
        exceeds `MAX_RATIO`.
        """
        mean, group = mean.copy(), list(self.inattentive)
        if group:
            mean[np.delete(group, np.argmax(np.abs(mean[group])))] = 0.0
        while True:
            theta = _tilts(self.prior, self.score, mean)
            ratio = np.exp(theta[:, None] * self.score)
            ratio /= (self.prior * ratio).sum(axis=1, keepdims=True)
            if np.prod(np.where(self.prior > 0, ratio, 0.0).max(axis=1)) <= MAX_RATIO:
                return np.asarray(ratio)
            mean *= 0.9


def _tilts(prior: FloatArray, score: FloatArray, mean: FloatArray) -> FloatArray:
    """Return θ (K,) by bisection."""
    low, high = np.full(len(mean), -MAX_TILT), np.full(len(mean), MAX_TILT)
    for _ in range(40):
        middle = (low + high) / 2
        mass = prior * np.exp(middle[:, None] * score)
        less = (mass * score).sum(axis=1) < mean * mass.sum(axis=1)
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    return np.where(mean == 0, 0.0, (low + high) / 2)


def normal_classes() -> tuple[FloatArray, FloatArray]:
    """Return probabilities (B,) and scores (B,) of the classes between `EDGES` of a normal variable."""
    ends = np.concatenate([[-np.inf], EDGES, [np.inf]])
    prior = np.diff(ndtr(ends))
    density = np.exp(-(ends**2) / 2) / np.sqrt(2 * np.pi)
    score = -np.diff(density) / prior
    return prior, score / np.sqrt((prior * score**2).sum())


UNIFORM_EDGES: Final = ndtr(EDGES)


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """Distribution of futures in which some vehicles draw from tilted classes.

    Attributes:
        vehicles: indices.
        ratio: (vehicles, K, B) likelihood ratio of classes.
        pair: of vehicles that shall collide.
        share: of the tilted futures, relative to other proposals.
    """

    vehicles: tuple[int, ...]
    ratio: FloatArray
    pair: tuple[int, int]
    share: float = 1.0

    def ratios(self, variables: Variables, draw: FloatArray) -> FloatArray:
        """Return the likelihood ratio (n,), proposal over prior, of futures (n, V)."""
        result = np.ones(len(draw))
        for vehicle, ratio in zip(self.vehicles, self.ratio, strict=True):
            result *= _ratio(variables, ratio, draw[:, vehicle])
        return result

    def draw(self, variables: Variables, plain: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Return futures (n, V): those given, with the numbers of the tilted vehicles drawn again."""
        draw = plain.copy()
        for vehicle, ratio in zip(self.vehicles, self.ratio, strict=True):
            kept, missing = [np.empty(0)], len(draw)
            while missing > 0:
                kept.append(_accepted(variables, ratio, missing, rng))
                missing -= len(kept[-1])
            draw[:, vehicle] = np.concatenate(kept)[: len(draw)]
        return draw


def _accepted(variables: Variables, ratio: FloatArray, wanted: int, rng: np.random.Generator) -> FloatArray:
    """Return numbers of a tilted vehicle, by rejection from about as many as the wanted ones need."""
    most = np.where(variables.prior > 0, ratio, 0.0).max(axis=1)
    number = rng.random(min(_CANDIDATES, 16 + int(1.2 * wanted * most.prod())))
    for k in np.argsort(-most, kind="stable").tolist():
        if most[k] > 1:
            kept = rng.random(len(number)) * most[k] < ratio[k][variables.classes(number, k)]
            number = number[kept]
    return number


def _ratio(variables: Variables, ratio: FloatArray, draw: FloatArray) -> FloatArray:
    result = np.ones(len(draw))
    for k in np.flatnonzero((ratio != 1).any(axis=1)).tolist():
        result *= ratio[k][variables.classes(draw, k)]
    return result


def weights(
    variables: Variables, plain: int, proposals: Sequence[Proposal], counts: Sequence[int], draw: FloatArray
) -> FloatArray:
    """Return the weight (n,) of each future (n, V) by the balance heuristic; their sum estimates 1.

    Args:
        plain: number of futures that were drawn without tilt.
        counts: number of futures of each proposal.

    Source: Veach, Guibas 1995.
    """
    total = np.full(len(draw), float(plain))
    for proposal, count in zip(proposals, counts, strict=True):
        total += count * proposal.ratios(variables, draw)
    return np.asarray(1.0 / total)
