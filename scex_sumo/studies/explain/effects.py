"""Effects of models: how values and critical shares depend on the models of vehicles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.statistics.density import CONFIDENCE, wilson
from scex_sumo.statistics.intervals import DesignIntervals

SPARE_CHILDREN: Final = 10
"""Children that a fit needs beyond its parameters; with fewer, nothing is said."""
_HUGE: Final = 1e100  # larger values are scaled, so that their squares are finite


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Share of a metric's variance that the models of one vehicle, or of two together, explain.

    Attributes:
        kind: ``main`` (one vehicle), ``pair`` (only two vehicles together), or ``rest`` (three and more
            together, and random routes).
        vehicle: index; -1 for the rest.
        other: index of the second vehicle of a pair, else -1.
        share: of the variance, less the expectation under chance; so it can be slightly negative.
        raw_share: as fitted; it grows with fewer children or more models.
        p_value: how often chance alone explains as much (F test).
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
    """Critical share of the children in which one or two vehicles have certain models.

    Attributes:
        critical: number of critical ones among them.
        share: critical share, with its 95 % interval ``low`` to ``high``.
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


def effects(
    levels: IntArray, values: FloatArray, progress: Callable[[int, int], None] | None = None
) -> list[list[Effect]]:
    """Decompose the variance of each column of values over the models of vehicles.

    Least squares on indicators of the models. A vehicle's main effect is what the fit of all vehicles loses
    without it. A pair's effect is what this fit gains by the pair's combinations. Where every combination
    occurs once, the effects are orthogonal and their shares the exact Sobol' indices. Elsewhere the
    expectation under chance is subtracted (degrees times the residual mean square, the epsilon-squared of
    Kelley 1935).

    Args:
        levels: (C, V) model of each vehicle in each child.
        values: (C, Q); undefined (NaN) and infinite ones are left out.
        progress: called with (vehicles done, vehicles in all).

    Returns:
        For each column main effects and pairs of all vehicles with more than one model, then the rest. Empty
        where the values do not vary, or are too few for the main effects; without pairs where they are too
        few for those.

    Source: Sobol' 1993; Saltelli et al. 2008.
    """
    # Columns with values in the same children share all but the last products of a fit.
    alike: dict[bytes, list[int]] = {}
    known = np.isfinite(values)
    for column in range(values.shape[1]):
        alike.setdefault(known[:, column].tobytes(), []).append(column)
    found: list[list[Effect]] = [[] for _ in range(values.shape[1])]
    for number, columns in enumerate(alike.values()):

        def tick(done: int, total: int, before: int = number) -> None:
            if progress is not None:
                progress(before * total + done, len(alike) * total)

        some = known[:, columns[0]]
        responses = [Response(values[some, column], found[column]) for column in columns]
        varying = [response for response in responses if response.varies]
        if varying:
            _decompose(levels[some], varying, _complete(levels, some), tick)
    return found


class Response:
    """(C,) values that a fit explains, and the effects found so far."""

    def __init__(self, values: FloatArray, effects: list[Effect]) -> None:
        self.effects = effects
        largest = float(np.abs(values).max(initial=0.0))
        unit = largest if largest > _HUGE else 1.0
        values = values / unit
        self.y = values - values.mean() if len(values) else values
        self.total = float(self.y @ self.y)
        self.varies = self.total > 1e-18 * max(1.0, (largest / unit) ** 2) * len(values)

    def fit(self, indicators: FloatArray, inverse: FloatArray) -> None:
        """Fit all main effects."""
        self.residual = self.y - indicators @ (inverse @ (indicators.T @ self.y))
        self.squares = float(self.residual @ self.residual)

    def add(
        self,
        kind: Literal["main", "pair"],
        vehicles: tuple[int, int],
        gain: float,
        degrees: int,
        squares: float,
        spare: int,
        exact: bool,
    ) -> None:
        """Add an effect from the sum of squares that it gains, and the residual ``squares`` and degrees."""
        from scipy.special import fdtrc

        noise, total = squares / spare if spare > 0 else 0.0, self.total
        ratio = gain / degrees / noise if degrees > 0 and noise > 1e-12 * total / max(spare, 1) else np.inf
        self.effects.append(
            Effect(
                kind=kind,
                vehicle=vehicles[0],
                other=vehicles[1],
                share=(gain - (0.0 if exact else degrees * noise)) / total,
                raw_share=gain / total,
                degrees=degrees,
                p_value=float(fdtrc(degrees, spare, ratio))
                if degrees > 0 and spare > 0 and gain > 0
                else 1.0,
            )
        )


def _decompose(
    levels: IntArray, responses: Sequence[Response], exact: bool, tick: Callable[[int, int], None]
) -> None:
    """Add the effects of all vehicles and pairs to responses, by normal equations: these are mere counts."""
    free = [v for v in range(levels.shape[1]) if len(np.unique(levels[:, v])) > 1]
    if not free:
        return
    count, parts = len(levels), [indicators(levels[:, v]) for v in free]
    every = np.concatenate([np.ones((count, 1)), *parts], axis=1)
    owner = np.concatenate([[-1], np.repeat(np.arange(len(parts)), [part.shape[1] for part in parts])])
    gram = every.T @ every
    inverse, rank = pseudo_inverse(gram)
    if count - rank < SPARE_CHILDREN and not exact:
        return
    for response in responses:
        response.fit(every, inverse)
    for index, vehicle in enumerate(free):
        kept = owner != index
        others = every[:, kept]
        without, rank_without = pseudo_inverse(gram[np.ix_(kept, kept)])
        for r in responses:
            residual = r.y - others @ (without @ (others.T @ r.y))
            gain = max(float(residual @ residual) - r.squares, 0.0)
            r.add("main", (vehicle, -1), gain, rank - rank_without, r.squares, count - rank, exact)
    for i, one in enumerate(free):
        for j in range(i + 1, len(free)):
            cells = (parts[i][:, :, None] * parts[j][:, None, :]).reshape(count, -1)
            across = every.T @ cells
            left, degrees = pseudo_inverse(cells.T @ cells - across.T @ inverse @ across, float(count))
            spare = count - rank - degrees
            if degrees == 0 or (spare < SPARE_CHILDREN and not exact):
                continue
            for r in responses:
                toward = cells.T @ r.residual
                gain = max(float(toward @ left @ toward), 0.0)
                r.add("pair", (one, free[j]), gain, degrees, max(r.squares - gain, 0.0), spare, exact)
        tick(i + 1, len(free))
    for r in responses:
        rest, raw = (1.0 - sum(getattr(e, name) for e in r.effects) for name in ("share", "raw_share"))
        nan = float("nan")
        r.effects.append(
            Effect(kind="rest", vehicle=-1, other=-1, share=rest, raw_share=raw, degrees=0, p_value=nan)
        )


def pseudo_inverse(gram: FloatArray, scale: float | None = None) -> tuple[FloatArray, int]:
    """Inverse of a symmetric matrix on its range, and its rank; ``scale`` is what counts as large."""
    size, vectors = np.linalg.eigh(gram)
    some = size > 1e-10 * (float(size[-1]) if scale is None else scale)
    return (vectors[:, some] / size[some]) @ vectors[:, some].T, int(some.sum())


def indicators(levels: IntArray) -> FloatArray:
    """(C, L) 1 where a child has a level, else 0, from (C,) levels of one vehicle."""
    return np.asarray(levels[:, None] == np.unique(levels)[None], dtype=np.float64)


def _complete(levels: IntArray, known: BoolArray) -> bool:
    """Whether every combination of the models occurs once, with a value."""
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
    """Compute critical shares under every model of one vehicle and of two.

    Args:
        levels: (C, V) model of each vehicle in each child.
        critical: (C,).
        pairs: two vehicles that are looked at together, the lower index first; None for any two.
        intervals: of the children, for conditions of one vehicle; else, and without, Wilson's intervals.
        least: conditions with fewer children are left out.

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
    """Return the conditions that are critical more often than chance would make any of so many."""
    from scipy.special import bdtrc

    limit = (1 - CONFIDENCE) / max(len(found), 1)
    return [c for c in found if c.critical and bdtrc(c.critical - 1, c.children, share) < limit]


def covering(
    levels: IntArray,
    critical: BoolArray,
    most: int,
    whole: Sequence[Condition],
    *,
    pairs: Collection[tuple[int, int]] | None = None,
) -> list[Condition]:
    """Choose at most ``most`` conditions that together account for much of what is critical.

    Each step takes the condition with the most critical children beyond the overall share, counted with the
    lower limit of Wilson's interval, among children without a condition taken so far; only those beyond
    chance count.

    Args:
        whole: all `conditions` of the same ``levels``, ``critical`` and ``pairs``.

    Returns:
        Conditions with their numbers over all children.

    Source: sequential covering, Clark, Niblett 1989.
    """
    overall = float(critical.mean()) if len(critical) else 0.0
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
