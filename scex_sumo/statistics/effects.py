"""Effects of models: how values and critical shares depend on who drives whom. Arrays in, numbers out."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.statistics.density import CONFIDENCE, wilson
from scex_sumo.statistics.intervals import DesignIntervals

SPARE_CHILDREN: Final = 10
"""Children that a fit needs beyond its parameters; with fewer, nothing is said."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """How much of a metric's variance the models of one vehicle, or of two together, explain.

    Attributes:
        kind: ``main`` (one vehicle), ``pair`` (what two vehicles' models do only together), or ``rest``
            (three and more together, and random routes).
        vehicle: index; -1 for the rest.
        other: index of the second vehicle of a pair, else -1.
        share: of the variance; without what chance alone would explain, so that it can be slightly negative.
        raw_share: as fitted; it never falls when there are fewer children or more models.
        degrees: free parameters.
        p_value: how often chance alone would explain as much (F test).
    """

    kind: Literal["main", "pair", "rest"]
    vehicle: int
    other: int
    share: float
    raw_share: float
    degrees: int
    p_value: float


@dataclass(frozen=True, kw_only=True)
class Condition:
    """How critical a scene becomes when one or two vehicles have certain models.

    Attributes:
        vehicles: one or two indices.
        models: their models.
        children: how many children are so.
        critical: how many of them are critical.
        share: critical share.
        low: lower limit of its 95 % interval.
        high: upper limit.
        covered: share of all critical children that are so.
    """

    vehicles: tuple[int, ...]
    models: tuple[int, ...]
    children: int
    critical: int
    share: float
    low: float
    high: float
    covered: float


def effects(levels: IntArray, values: FloatArray) -> list[Effect]:
    """Decompose the variance of values over who drove whom.

    Least squares on indicators of the models. A vehicle's main effect is what the fit of all vehicles loses
    without it; a pair's effect is what the fit of all vehicles gains by the pair's combinations. Where every
    combination is there once, the effects are orthogonal and their shares the exact Sobol' indices. Elsewhere
    the expectation under chance is taken off (degrees times the residual mean square, the epsilon-squared of
    Kelley 1935).

    Args:
        levels: (C, V) model of each vehicle in each child.
        values: (C,) NaN where undefined; undefined and infinite ones are left out.

    Returns:
        Main effects and pairs of all vehicles that have more than one model, then the rest; none where the
        values do not vary or there are too few of them for the main effects. Pairs are left out where there
        are too few children for them.

    Source: Sobol' 1993; Saltelli et al. 2008.
    """
    known = np.isfinite(values)
    y = values[known] - (values[known].mean() if known.any() else 0.0)
    x = levels[known]
    total = float(y @ y)
    free = [v for v in range(x.shape[1]) if len(np.unique(x[:, v])) > 1] if len(x) else []
    if not free or total <= 1e-18 * max(1.0, float(np.abs(values[known]).max()) ** 2) * len(y):
        return []
    exact = _complete(levels, known)
    fit = _Fit(x[:, free], y)
    if len(y) - fit.rank < SPARE_CHILDREN and not exact:
        return []
    found = []
    for index, vehicle in enumerate(free):
        gain, degrees = fit.of_one(index)
        spare = len(y) - fit.rank
        found.append(_effect("main", vehicle, -1, gain, degrees, fit.squares, spare, total, exact))
    for (i, one), (j, two) in combinations(enumerate(free), 2):
        gain, degrees = fit.of_two(i, j)
        spare = len(y) - fit.rank - degrees
        if degrees > 0 and (spare >= SPARE_CHILDREN or exact):
            left_over = max(fit.squares - gain, 0.0)
            found.append(_effect("pair", one, two, gain, degrees, left_over, spare, total, exact))
    rest = 1.0 - sum(e.share for e in found)
    raw = 1.0 - sum(e.raw_share for e in found)
    nan = float("nan")
    left = Effect(kind="rest", vehicle=-1, other=-1, share=rest, raw_share=raw, degrees=0, p_value=nan)
    return [*found, left]


class _Fit:
    """Least squares on indicators of every vehicle's models, by normal equations: they are mere counts."""

    def __init__(self, levels: IntArray, y: FloatArray) -> None:
        self._y = y
        self._parts = [indicators(levels[:, v]) for v in range(levels.shape[1])]
        self._all = np.concatenate([np.ones((len(y), 1)), *self._parts], axis=1)
        owner = np.repeat(np.arange(len(self._parts)), [p.shape[1] for p in self._parts])
        self._owner = np.concatenate([[-1], owner])
        self._gram = self._all.T @ self._all
        self._inverse, self.rank = pseudo_inverse(self._gram)
        self._residual = y - self._all @ (self._inverse @ (self._all.T @ y))
        self.squares = float(self._residual @ self._residual)

    def of_one(self, vehicle: int) -> tuple[float, int]:
        """Sum of squares and degrees of freedom that the fit loses without a vehicle."""
        kept = self._owner != vehicle
        inverse, rank = pseudo_inverse(self._gram[np.ix_(kept, kept)])
        others = self._all[:, kept]
        residual = self._y - others @ (inverse @ (others.T @ self._y))
        return max(float(residual @ residual) - self.squares, 0.0), self.rank - rank

    def of_two(self, one: int, two: int) -> tuple[float, int]:
        """Sum of squares and degrees of freedom that the fit gains by all combinations of two vehicles."""
        first, second = self._parts[one], self._parts[two]
        cells = (first[:, :, None] * second[:, None, :]).reshape(len(self._y), -1)
        across = self._all.T @ cells
        inverse, rank = pseudo_inverse(cells.T @ cells - across.T @ self._inverse @ across, float(len(cells)))
        toward = cells.T @ self._residual
        return max(float(toward @ inverse @ toward), 0.0), rank


def pseudo_inverse(gram: FloatArray, scale: float | None = None) -> tuple[FloatArray, int]:
    """Inverse of a symmetric matrix on its range, and its rank; ``scale`` is what counts as large."""
    size, vectors = np.linalg.eigh(gram)
    some = size > 1e-10 * (float(size[-1]) if scale is None else scale)
    return (vectors[:, some] / size[some]) @ vectors[:, some].T, int(some.sum())


def _effect(
    kind: Literal["main", "pair"],
    vehicle: int,
    other: int,
    gain: float,
    degrees: int,
    squares: float,
    spare: int,
    total: float,
    exact: bool,
) -> Effect:
    from scipy.special import fdtrc

    noise = squares / spare if spare > 0 else 0.0
    ratio = gain / degrees / noise if degrees > 0 and noise > 1e-12 * total / max(spare, 1) else np.inf
    return Effect(
        kind=kind,
        vehicle=vehicle,
        other=other,
        share=(gain - (0.0 if exact else degrees * noise)) / total,
        raw_share=gain / total,
        degrees=degrees,
        p_value=float(fdtrc(degrees, spare, ratio)) if degrees > 0 and spare > 0 and gain > 0 else 1.0,
    )


def indicators(levels: IntArray) -> FloatArray:
    """(C, L) 1 where a child has a level, by (C,) levels of one vehicle, else 0."""
    return np.asarray(levels[:, None] == np.unique(levels)[None], dtype=np.float64)


def _complete(levels: IntArray, known: BoolArray) -> bool:
    """Whether every combination of the models is there once, with a value."""
    combinations_ = int(np.prod([len(np.unique(levels[:, v])) for v in range(levels.shape[1])]))
    return bool(known.all()) and len(levels) == combinations_ == len(np.unique(levels, axis=0))


def conditions(
    levels: IntArray,
    critical: BoolArray,
    *,
    pairs: Collection[tuple[int, int]] | None = None,
    intervals: DesignIntervals | None = None,
    least: int = 5,
) -> list[Condition]:
    """Critical share under every model of one vehicle and of two, the surest ones first.

    Args:
        levels: (C, V) model of each vehicle in each child.
        critical: (C,) whether the child is critical.
        pairs: two vehicles whose models are looked at together, the lower index first; None for any two.
        intervals: of the children: those with one model of a vehicle are a design of the others. Without,
            and for two vehicles, where few children are left, Wilson's.
        least: conditions that hold in fewer children are left out.

    Returns:
        Ordered by the lower limit of the critical share, highest first; of equals, the simpler first.
    """
    total = int(critical.sum())
    found = []
    free = [v for v in range(levels.shape[1]) if len(np.unique(levels[:, v])) > 1]
    twos = [two for two in combinations(free, 2) if pairs is None or two in pairs]
    for group in [*((v,) for v in free), *twos]:
        kinds, which = np.unique(levels[:, group], axis=0, return_inverse=True)
        counts = np.bincount(which.reshape(-1), minlength=len(kinds))
        hits = np.bincount(which.reshape(-1), critical, minlength=len(kinds))
        for models, count, hit in zip(kinds.tolist(), counts.tolist(), hits.tolist(), strict=True):
            if count < least:
                continue
            interval = wilson(int(hit), count)
            if intervals is not None and len(group) == 1:
                mine = levels[:, group[0]] == models[0]
                interval = intervals.among(group[0], int(np.argmax(mine))).share(critical[mine])
            found.append(
                Condition(
                    vehicles=group,
                    models=tuple(models),
                    children=count,
                    critical=int(hit),
                    share=interval.value,
                    low=interval.low,
                    high=interval.high,
                    covered=int(hit) / total if total else 0.0,
                )
            )
    return sorted(found, key=lambda c: (-c.low, len(c.vehicles), c.vehicles, c.models))


def beyond_chance(found: Sequence[Condition], share: float) -> list[Condition]:
    """Conditions that are critical more often than chance alone would make any of so many.

    Args:
        found: all that were looked at.
        share: critical share of all children.
    """
    from scipy.special import bdtrc

    limit = (1 - CONFIDENCE) / max(len(found), 1)
    return [c for c in found if c.critical and bdtrc(c.critical - 1, c.children, share) < limit]


def covering(
    levels: IntArray,
    critical: BoolArray,
    most: int,
    *,
    pairs: Collection[tuple[int, int]] | None = None,
    intervals: DesignIntervals | None = None,
) -> list[Condition]:
    """A few conditions that together account for much of what is critical.

    One after the other, the condition is taken under which most children are critical beyond the overall
    share, counted with the lower limit of Wilson's interval, among those children to which none taken so far
    applies; only those count that are beyond chance.

    Args:
        levels: (C, V) model of each vehicle in each child.
        critical: (C,) whether the child is critical.
        most: how many.
        pairs: as of `conditions`.
        intervals: as of `conditions`.

    Returns:
        Conditions with their numbers over all children.

    Source: sequential covering, Clark, Niblett 1989.
    """
    overall = float(critical.mean()) if len(critical) else 0.0
    whole = conditions(levels, critical, pairs=pairs, intervals=intervals)
    by_name = {(c.vehicles, c.models): c for c in whole}
    left = np.ones(len(critical), dtype=bool)
    taken: list[Condition] = []
    while len(taken) < most:
        rules = beyond_chance(conditions(levels[left], critical[left], pairs=pairs), overall)
        gains = [(c.low - overall) * c.children for c in rules]
        if not gains or max(gains) <= 0:
            break
        best = rules[int(np.argmax(gains))]
        taken.append(by_name[best.vehicles, best.models])
        left &= ~(levels[:, best.vehicles] == best.models).all(axis=1)
    return taken
