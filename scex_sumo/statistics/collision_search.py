"""Search for rare collisions: simulations of pairs, chosen by forests, and futures of close ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.statistics.forest import Forest
from scex_sumo.statistics.importance import FAR_M, Outcomes, Sampled, drawn_by_size, joined

SIMULATED: Final = 8
"""Simulations of pairs for each extra future, up to `MAX_SIMULATED`."""
MAX_SIMULATED: Final = 30_000
ROUND: Final = 200
"""Simulations of a round; there are up to `MAX_ROUNDS`."""
MAX_ROUNDS: Final = 8
MIN_PAIRS: Final = 3
CHOSEN_SHARE: Final = 0.5
"""Largest share of the extra futures that are chosen."""

_NUMBERS = (300, 4000)  # limits of how many of each vehicle are tried: eight times the extra futures
_CANDIDATES = 100  # pairs of these numbers for each that is simulated, up to
_MOST = 1 << 15
_FIRST = 2  # part of a round that a pair gets at first; later rounds at most double its simulations
_TAIL = 12  # simulations in which a pair is closest
_ELITE = 0.03  # share of the simulations, beyond `_TAIL`, that are close
_POWER = 3.0  # of the predicted closeness
_FLOOR = 1e-5  # of the largest score
_MIN_SHARE = 0.03
_NEAR_M, _NEAR_SCALE_M = 0.2, 0.03  # least gaps of pairs that may collide in a whole future


class Futures(Protocol):
    """Futures that can be run, and what is known of them before.

    The vehicles' numbers (N, V) in [0, 1) are independent; all random variables of a vehicle follow from its
    number.
    """

    def run(self, draw: FloatArray) -> Outcomes:
        """Run futures with numbers (N, V)."""

    def first_plans(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        """Return the first plans (N, W, ...) of W vehicles, which depend on their numbers (N, W) alone."""

    def features(self, pair: tuple[int, int], plans: FloatArray) -> FloatArray:
        """Return features (N, K) of the first plans (N, 2, ...) of a pair."""

    def pair_gaps(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        """Return the least gaps (n,) of pairs (n, 2) with numbers (n, 2), whatever the others draw, m.

        A pair collides at 0 or less. This is an approximation that costs less than a future.
        """


def sample_rare(
    futures: Futures,
    plain: FloatArray,
    outcomes: Outcomes,
    extra: int,
    *,
    draws_any: BoolArray,
    rng: np.random.Generator,
) -> Sampled:
    """Run futures near collisions beside the plain ones.

    In each round, a forest per pair predicts from the first plans how close a pair comes. Many pairs of
    numbers are drawn, and those that come close are simulated more often: the pair alone, among the others
    of a plain future. Whole futures are run for those that collide or nearly do so; the others then have
    plain numbers. The remaining extra futures are plain.

    Args:
        plain: (N, V) numbers of futures that were drawn plainly, with their outcomes.
        extra: number of futures to run.
        draws_any: (V,) whether a vehicle draws anything.

    Source: multifidelity importance sampling, Peherstorfer et al. 2016.
    """
    simulated = min(SIMULATED * extra, MAX_SIMULATED)
    rounds = int(np.clip(simulated // ROUND, 1, MAX_ROUNDS))
    tried = rng.random((int(np.clip(8 * extra, *_NUMBERS)), plain.shape[1]))
    search = _Search(futures, plain, outcomes, draws_any, tried)
    for size in np.diff(simulated * np.arange(rounds + 1) // rounds).tolist():
        search.simulate(size, rng)
    return search.run(extra, rng)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Proposal:
    """Distribution in which the numbers of a pair are chosen by a forest.

    Attributes:
        count: of pairs that were drawn.
        floor: of the score, which is at most ``cap``.
        mean: of the score over all numbers.
    """

    count: int
    forest: Forest
    floor: float
    cap: float
    mean: float

    def density(self, features: FloatArray, *, fitted: int) -> FloatArray:
        """Return how many pairs are drawn (n,) with features (n, K), over the prior density.

        Args:
            fitted: number of the first samples that the forest was fitted to, as of `Forest.predict`.
        """
        score = self.forest.predict(features, fitted=fitted, power=_POWER) + self.floor
        return np.asarray(np.minimum(score, self.cap) * (self.count / self.mean))


class _Drawn:
    """Numbers (N, V) of vehicles, and what they plan at first."""

    def __init__(self, futures: Futures, draw: FloatArray) -> None:
        self._futures, self.draw = futures, draw
        self._plans: dict[int, FloatArray] = {}

    def know(self, vehicles: IntArray) -> None:
        """Find the first plans of vehicles."""
        new = np.setdiff1d(vehicles, sorted(self._plans))
        if len(new):
            plans = self._futures.first_plans(new, self.draw[:, new])
            self._plans |= {vehicle: plans[:, k] for k, vehicle in enumerate(new.tolist())}

    def features(self, pair: tuple[int, int], one: IntArray, other: IntArray) -> FloatArray:
        """Return the features (n, K) of a pair with numbers in rows (n,) of either vehicle."""
        plans = [self._plans[vehicle][rows] for vehicle, rows in zip(pair, (one, other), strict=True)]
        return self._futures.features(pair, np.stack(plans, axis=1))


class _Pair:
    """Simulations of a pair, after the plain futures, and the proposals that they were drawn from.

    Attributes:
        draw: (n, 2) numbers.
        gap: (n,) least gaps, m, not below 0.
        density: (n,) of all proposals over the prior one.
    """

    def __init__(self, pair: tuple[int, int], drawn: _Drawn, gap: FloatArray) -> None:
        plain = np.arange(len(gap))
        self.pair, self.draw, self.gap = pair, drawn.draw[plain[:, None], list(pair)], gap
        self.density = np.zeros(len(gap))
        self._features = drawn.features(pair, plain, plain)
        self._proposals: list[_Proposal] = []

    def propose(self, drawn: _Drawn, tried: int, count: int, rng: np.random.Generator) -> FloatArray:
        """Return the numbers (count, 2) of more simulations, from those after the first ``tried`` ones."""
        fitted = len(self.gap)
        forest = Forest(self._features, _closeness(self.gap), rng)
        numbers = len(drawn.draw) - tried
        number = np.arange(min(_CANDIDATES * count, max(_MOST, 2 * count)))
        one = number % numbers
        other = tried + rng.permutation(numbers)[(one + number // numbers) % numbers]
        one = tried + one
        # The mean of powers: fewer trees then have the same expectation.
        predicted = forest.predict(drawn.features(self.pair, one, other), fitted=0, power=_POWER)
        floor = _FLOOR * float(predicted.max())
        score = predicted + floor
        # Systematic sampling draws no candidate twice if none has more than its share.
        cap = float(np.sort(score)[-count])
        score = np.minimum(score, cap)
        ends = np.cumsum(score)
        at = np.searchsorted(ends, (rng.random() + np.arange(count)) * ends[-1] / count, side="right")
        at = np.minimum(at, len(score) - 1)
        made = _Proposal(count=count, forest=forest, floor=floor, cap=cap, mean=float(score.mean()))
        self._proposals.append(made)
        features = drawn.features(self.pair, one[at], other[at])
        known = self.density + made.density(self._features, fitted=fitted)
        self.density = np.concatenate([known, self.density_of(features)])
        self._features = np.concatenate([self._features, features])
        new = np.stack([drawn.draw[one[at], self.pair[0]], drawn.draw[other[at], self.pair[1]]], axis=1)
        self.draw = np.concatenate([self.draw, new])
        return self.draw[fitted:]

    def spread(self, plain: int) -> float:
        """Return the relative variance of the sum of weights of simulations that nearly collide.

        It is clustered by either number, as many pairs are made of few numbers of each vehicle.

        Source: Cameron, Gelbach, Miller 2011.
        """
        weight = _nearness(self.gap[plain:]) / self.density[plain:]
        total, result = float(weight.sum()), -float((weight**2).sum())
        if not total:
            return 0.0
        for numbers in self.draw[plain:].T:
            _, group = np.unique(numbers, return_inverse=True)
            result += float((np.bincount(group, weight) ** 2).sum())
        return result / total**2

    def density_of(self, features: FloatArray) -> FloatArray:
        """Return the density (n,) at features (n, K) of other simulations."""
        return np.asarray(np.sum([one.density(features, fitted=0) for one in self._proposals], axis=0))


class _Search:
    """Simulations of all pairs so far."""

    def __init__(
        self, futures: Futures, plain: FloatArray, outcomes: Outcomes, draws_any: BoolArray, tried: FloatArray
    ) -> None:
        self._futures, self._outcomes, self._plain = futures, outcomes, plain
        self._drawn = _Drawn(futures, np.concatenate([plain, tried]))
        self._near = [pair for pair in outcomes.pairs() if draws_any[list(pair)].any()]
        self._pairs: dict[tuple[int, int], _Pair] = {}
        self._most = MIN_PAIRS + len(tried) // 1000

    def simulate(self, size: int, rng: np.random.Generator) -> None:
        """Simulate pairs another ``size`` times."""
        pairs, share = self._closest()
        done = [len(self._pairs[p].gap) - len(self._plain) if p in self._pairs else 0 for p in pairs]
        counts = _shared_out(size, share, np.maximum(done, size / _FIRST))
        pairs, counts = [p for p, n in zip(pairs, counts, strict=True) if n], counts[counts > 0]
        if not pairs:
            return
        self._drawn.know(np.unique(np.array(pairs, dtype=np.int64)))
        for pair in pairs:
            if pair not in self._pairs:
                self._pairs[pair] = _Pair(pair, self._drawn, self._outcomes.of(pair)[0])
        drawn = [
            self._pairs[p].propose(self._drawn, len(self._plain), n, rng)
            for p, n in zip(pairs, counts, strict=True)
        ]
        gaps = self._futures.pair_gaps(np.repeat(pairs, counts, axis=0), np.concatenate(drawn))
        for pair, gap in zip(pairs, np.split(gaps, np.cumsum(counts)[:-1]), strict=True):
            one = self._pairs[pair]
            one.gap = np.concatenate([one.gap, np.clip(gap, 0.0, FAR_M)])

    def _closest(self) -> tuple[list[tuple[int, int]], FloatArray]:
        """Return the pairs that are most likely to collide, and their shares of the next simulations.

        The gaps below a small one are exponential, as far as simulations show them.
        """
        found: list[tuple[float, tuple[int, int]]] = []
        for pair in self._near:
            gap = self._pairs[pair].gap if pair in self._pairs else self._outcomes.of(pair)[0]
            near = np.sort(gap)[: _TAIL + 1]
            below = max(float((near[-1] - near[:-1]).mean()), 1e-9)
            found.append((float(np.exp(-near[-1] / below)) / len(gap), pair))
        found.sort(key=lambda one: (-one[0], one[1]))
        some = [one for one in found[: self._most] if one[0] > _MIN_SHARE * found[0][0]]
        share = np.array([value for value, _ in some])
        return [pair for _, pair in some], share / max(share.sum(), 1e-300)

    def run(self, extra: int, rng: np.random.Generator) -> Sampled:
        """Run ``extra`` futures, first those of pairs that nearly collide."""
        pairs, known = list(self._pairs.values()), len(self._plain)
        near = [known + np.flatnonzero(one.gap[known:] < _NEAR_M) for one in pairs]
        which = np.repeat(np.arange(len(pairs)), [len(rows) for rows in near])
        row = np.concatenate([*near, np.empty(0, dtype=np.int64)])
        of_near = [(one.gap[rows], one.density[rows]) for one, rows in zip(pairs, near, strict=True)]
        gap, density = np.concatenate([np.empty((2, 0)), *map(np.array, of_near)], axis=1)
        count = min(int(CHOSEN_SHARE * extra), len(row))
        drawn, chance, factor = drawn_by_size(_nearness(gap) / density, count, rng)
        # The simulation that a future was chosen for, or its own place among the plain ones.
        chosen, source = np.full(known + extra, -1), np.full(known + extra, -1)
        source[:known] = np.arange(known)
        chosen[known : known + count], source[known : known + count] = which[drawn], row[drawn]
        draw = np.concatenate([self._plain, rng.random((extra, self._plain.shape[1]))])
        for k, one in enumerate(pairs):
            own = np.flatnonzero(chosen == k)
            draw[own[:, None], list(one.pair)] = one.draw[source[own]]
        outcomes = joined([self._outcomes, self._futures.run(draw[known:])])
        # A collision of another pair than that which a future was chosen for does not count.
        hits = [outcomes.of(one.pair)[1] for one in pairs]
        counts = (chosen < 0) & outcomes.hits()
        for k, hit in enumerate(hits):
            counts |= (chosen == k) & hit
        plain = float((chosen < 0).sum())
        expected = np.full(len(draw), plain)
        for k, (one, hit) in enumerate(zip(pairs, hits, strict=True)):
            rows = np.flatnonzero(counts & hit)
            at = np.where((chosen[rows] == k) | (rows < known), source[rows], -1)
            gap_then, density_then = self._foretold(one, at, draw[rows][:, list(one.pair)])
            expected[rows] += np.minimum(density_then, factor * _nearness(gap_then))
        return Sampled(
            draw=draw,
            outcomes=outcomes,
            weight=np.where(counts, 1 / expected, 0.0),
            chosen=chosen,
            pairs=tuple(self._pairs),
            chance=np.concatenate([np.zeros(known), chance, np.zeros(extra - count)]),
            spreads=np.array([one.spread(known) for one in pairs]),
            next_weight=float((1 / (plain + density)).max(initial=0.0)),
            simulated=sum(len(one.gap) - known for one in pairs),
        )

    def _foretold(self, one: _Pair, row: IntArray, draw: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return least gaps (n,) and densities (n,) of simulations of a pair with numbers (n, 2).

        Args:
            row: (n,) of the pair; -1 if it was not simulated with these numbers, nor in a plain future.
        """
        gap, density = one.gap[row], one.density[row]
        if (fresh := row < len(self._plain)).any():
            vehicles = np.repeat([one.pair], int(fresh.sum()), axis=0)
            gap[fresh] = self._futures.pair_gaps(vehicles, draw[fresh])
        if (new := row < 0).any():
            plans = self._futures.first_plans(np.array(one.pair), draw[new])
            density[new] = one.density_of(self._futures.features(one.pair, plans))
        return gap, density


def _shared_out(total: int, share: FloatArray, limit: FloatArray) -> IntArray:
    """Return counts (n,) with shares (n,) of a total, each within its limit if the limits allow it."""
    limit = limit * max(1.0, total / max(limit.sum(), 1e-300))
    full = np.zeros(len(share), dtype=np.bool_)
    while True:
        left = total - limit[full].sum()
        wanted = np.where(full, limit, left * share / max(share[~full].sum(), 1e-300))
        if not (above := ~full & (wanted > limit)).any():
            return np.asarray(np.diff(np.rint(np.cumsum([0.0, *wanted]))), dtype=np.int64)
        full |= above


def _nearness(gap: FloatArray) -> FloatArray:
    """Return from 0 to 1 how likely pairs with a least gap (n,) collide in a whole future, about."""
    return np.where(gap < _NEAR_M, np.exp(-np.maximum(gap, 0.0) / _NEAR_SCALE_M), 0.0)


def _closeness(gap: FloatArray) -> FloatArray:
    """Return exp(-gap / scale) (n,) from 0 to 1, which is effectively 1 in an elite of the futures."""
    wanted = _TAIL + _ELITE * len(gap)
    low, high = 1e-3, 10 * FAR_M
    for _ in range(30):
        scale = np.sqrt(low * high)
        value = np.exp(-(gap - gap.min()) / scale)
        few = value.sum() ** 2 < wanted * (value**2).sum()
        low, high = (scale, high) if few else (low, scale)
    return np.asarray(np.exp(-(gap - gap.min()) / scale))
