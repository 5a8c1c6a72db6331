"""Effects of models: how values and critical shares depend on the models of vehicles."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.statistics.density import CONFIDENCE, wilson

FUTURES_PER_PARAMETER: Final = 5
"""Futures that each parameter of a fit needs."""
MIN_FUTURES: Final = 5
"""Conditions of fewer futures are left out."""
_TRIED: Final = 5  # pairs of the largest screened gain that are tested in each step
_HUGE: Final = 1e100  # larger values are scaled, so that their squares are finite


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Share of a metric's variance that the models of one vehicle, or of two together, explain.

    Attributes:
        kind: ``main`` (one vehicle), ``pair`` (two vehicles beyond their main effects), or ``rest``.
        vehicle: index; -1 for the rest.
        other: index of the second vehicle of a pair, else -1.
        share: less the expectation under chance, 0 to 1; all shares of a metric sum to 1.
        raw_share: as fitted.
        p_value: of the F test; NaN for the rest and if all assignments were run.
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
    """Critical share of the futures in which one or two vehicles have certain models.

    Attributes:
        share: critical share, with Wilson's 95 % interval ``low`` to ``high``, as in the report.
        covered: share of all critical futures that are so.
    """

    vehicles: tuple[int, ...]
    models: tuple[int, ...]
    futures: int
    critical: int
    share: float
    low: float
    high: float
    covered: float


class Cells:
    """Futures by the models of one vehicle or two, for G groups of vehicles and K cells in all.

    Attributes:
        groups: (G) indices of one vehicle or two.
        group: (K,) group of each cell.
        count: (K,) futures in each cell.
    """

    def __init__(self, levels: IntArray, groups: Sequence[tuple[int, ...]]) -> None:
        self.groups, names = list(groups), int(levels.max(initial=0)) + 1
        first, last = (levels[:, [group[end] for group in self.groups]] for end in (0, -1))
        numbers = (np.arange(len(self.groups)) * names + first) * names + last
        used, code = np.unique(numbers, return_inverse=True)
        self._code = code.reshape(-1).astype(np.int64)
        self.group, self._models = used // names**2, np.stack([used // names % names, used % names], axis=1)
        self.count = np.bincount(self._code, minlength=len(used))

    def sums(self, weights: FloatArray | BoolArray) -> FloatArray:
        """Return the sums (K,) of the weights (C,) of the futures in each cell."""
        every = np.repeat(weights, len(self.groups))
        return np.bincount(self._code, every, minlength=len(self.count)).astype(np.float64)

    def of(self, group: int) -> IntArray:
        """Return the cell (C,) of each future in one group."""
        return np.asarray(self._code[group :: len(self.groups)])

    def squares(self, values: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return sums of squares (G,) of values of mean 0 between the cells, and degrees (G,)."""
        between = self.sums(values) ** 2 / self.count
        size = len(self.groups)
        degrees = np.bincount(self.group, minlength=size).astype(np.int64) - 1
        return np.bincount(self.group, between, minlength=size).astype(np.float64), degrees

    def models(self, cell: int) -> tuple[int, ...]:
        """Return the models of the vehicles of a cell."""
        return tuple(self._models[cell, : len(self.groups[self.group[cell]])].tolist())


def drawn_vehicles(levels: IntArray) -> list[int]:
    """Return the vehicles that have more than one model in (C, V) assignments."""
    return np.flatnonzero((levels != levels[:1]).any(axis=0)).tolist()


def all_cells(levels: IntArray, pairs: Collection[tuple[int, int]] | None = None) -> Cells:
    """Return the cells of drawn vehicles and of ``pairs`` of them, the lower index first; None: all pairs."""
    free = drawn_vehicles(levels)
    twos = [two for two in combinations(free, 2) if pairs is None or two in pairs]
    return Cells(levels, [*((v,) for v in free), *twos])


def effects(
    levels: IntArray,
    values: FloatArray,
    *,
    pairs: Collection[tuple[int, int]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[list[Effect]]:
    """Decompose the variance of each column of values over the models of vehicles.

    Exact Sobol' indices if every assignment occurs once. Else a least squares fit by forward selection:
    vehicles, then pairs, enter if the F test finds them beyond chance (5 % after Bonferroni) and
    `FUTURES_PER_PARAMETER` allows.

    Args:
        levels: (C, V) model of each vehicle in each future.
        values: (C, Q); only finite ones count.
        pairs: vehicles that may have an effect together, the lower index first; None for any two.
        progress: called with (columns done, columns in all).

    Returns:
        For each column the effects, then the rest; empty if the values do not vary, or are too few.

    Source: Sobol' 1993; Efroymson 1960 for the selection; Kelley 1935 for the expectation under chance.
    """
    effects_of = []
    for column in range(values.shape[1]):
        known = np.isfinite(values[:, column])
        effects_of.append(_effects_of(levels[known], values[known, column], pairs, whole=bool(known.all())))
        if progress is not None:
            progress(column + 1, values.shape[1])
    return effects_of


def _effects_of(
    levels: IntArray, values: FloatArray, pairs: Collection[tuple[int, int]] | None, *, whole: bool
) -> list[Effect]:
    largest = float(np.abs(values).max(initial=0.0))
    unit = largest if largest > _HUGE else 1.0
    y = values / unit
    y = y - y.mean() if len(y) else y
    free = drawn_vehicles(levels)
    if not free or float(y @ y) <= 1e-18 * max(1.0, (largest / unit) ** 2) * len(y):
        return []
    fit = _Fit(y)
    assignments = int(np.prod([len(np.unique(levels[:, v])) for v in free], dtype=np.float64))
    if whole and len(levels) == assignments == len(np.unique(levels, axis=0)):
        fit.add_all(all_cells(levels))
    elif len(y) < FUTURES_PER_PARAMETER * min(len(np.unique(levels[:, v])) for v in free):
        return []
    else:
        cells = all_cells(levels, pairs)
        while fit.add_best(cells, 1) or fit.add_best(cells, 2):
            pass
    return fit.effects()


class _Fit:
    def __init__(self, values: FloatArray) -> None:
        self.total, self.residual = float(values @ values), values
        self.basis = np.full((len(values), 1), len(values) ** -0.5)  # orthonormal
        self.terms: dict[tuple[int, ...], tuple[float, int, float]] = {}  # gain, degrees, p value

    def add_all(self, cells: Cells) -> None:
        """Add all terms of a design in which they are orthogonal."""
        gains, degrees = cells.squares(self.residual)
        for term, gain, free in zip(cells.groups, gains.tolist(), degrees.tolist(), strict=True):
            inner = [self.terms[v,] for v in term] if len(term) > 1 else []
            beyond = max(gain - sum(part[0] for part in inner), 0.0)
            self.terms[term] = beyond, free - sum(part[1] for part in inner), float("nan")
        self.residual = np.zeros_like(self.residual)

    def add_best(self, cells: Cells, size: int) -> bool:
        """Add the best term of ``size`` vehicles, a pair with both; return False if none is beyond chance."""
        candidates = [g for g, term in enumerate(cells.groups) if len(term) == size]
        left = float(self.residual @ self.residual)
        if not candidates or left <= 1e-12 * self.total:
            return False
        gains, degrees = cells.squares(self.residual)
        # Without what the fit holds already, a term gains at least this.
        order = sorted(candidates, key=lambda g: degrees[g] / max(float(gains[g]), 1e-300))
        limit = (1 - CONFIDENCE) / len(candidates)
        new = [cells.groups[g] for g in order if cells.groups[g] not in self.terms]
        return any(self._add(term, cells, limit) for term in new[: 1 if size == 1 else _TRIED])

    def _add(self, term: tuple[int, ...], cells: Cells, limit: float) -> bool:
        from scipy.special import fdtrc

        basis, residual, count = self.basis, self.residual, len(self.residual)
        added: dict[tuple[int, ...], tuple[float, int, float]] = {}
        p_value = 1.0
        for part in dict.fromkeys([*((v,) for v in term), term]):
            if part in self.terms:
                continue
            code = cells.of(cells.groups.index(part))
            x = np.asarray(code[:, None] == np.unique(code), dtype=np.float64)
            x -= basis @ (basis.T @ x)
            vectors, size, _ = np.linalg.svd(x, full_matrices=False)
            new = vectors[:, size > 1e-6]
            degrees, spare = new.shape[1], count - basis.shape[1] - new.shape[1]
            basis, along = np.concatenate([basis, new], axis=1), new.T @ residual
            if not degrees or basis.shape[1] * FUTURES_PER_PARAMETER > count:
                return False
            gain, residual = float(along @ along), residual - new @ along
            noise = float(residual @ residual) / spare
            p_value = float(fdtrc(degrees, spare, gain / degrees / max(noise, 1e-300)))
            added[part] = gain, degrees, p_value
        if p_value >= limit:
            return False
        self.basis, self.residual, self.terms = basis, residual, self.terms | added
        return True

    def effects(self) -> list[Effect]:
        """Return the terms as effects, then the rest."""
        noise = float(self.residual @ self.residual) / (len(self.residual) - self.basis.shape[1])
        terms = [
            Effect(
                kind="main" if len(term) == 1 else "pair",
                vehicle=term[0],
                other=-1 if len(term) == 1 else term[1],
                share=max(gain - degrees * noise, 0.0) / self.total,
                raw_share=gain / self.total,
                degrees=degrees,
                p_value=p_value,
            )
            for term, (gain, degrees, p_value) in sorted(self.terms.items(), key=lambda t: (len(t[0]), t[0]))
        ]
        rest, raw = (max(1.0 - sum(getattr(e, name) for e in terms), 0.0) for name in ("share", "raw_share"))
        nan = float("nan")
        whole = Effect(kind="rest", vehicle=-1, other=-1, share=rest, raw_share=raw, degrees=0, p_value=nan)
        return [*terms, whole]


def conditions(cells: Cells, critical: BoolArray) -> list[Condition]:
    """Return critical shares (of (C,) critical futures) under models, if beyond chance.

    Ordered by the lower limit of the critical share, highest first; of equals, the simpler first.
    """
    hits = cells.sums(critical)
    beyond = _beyond_chance(cells.count, hits, float(np.mean(critical)))
    told = [_condition(cells, cell, hits, int(critical.sum())) for cell in beyond]
    return sorted(told, key=lambda c: (-c.low, len(c.vehicles), c.vehicles, c.models))


def _beyond_chance(count: FloatArray | IntArray, hits: FloatArray, share: float) -> list[int]:
    from scipy.special import bdtrc

    enough = count >= MIN_FUTURES
    limit = (1 - CONFIDENCE) / max(int(enough.sum()), 1)
    chance = bdtrc(np.maximum(hits - 1, 0), count.astype(np.int64), share)
    return np.flatnonzero(enough & (hits > 0) & (chance < limit)).tolist()


def _condition(cells: Cells, cell: int, hits: FloatArray, total: int) -> Condition:
    interval = wilson(int(hits[cell]), int(cells.count[cell]))
    return Condition(
        vehicles=cells.groups[cells.group[cell]],
        models=cells.models(cell),
        futures=int(cells.count[cell]),
        critical=int(hits[cell]),
        share=interval.value,
        low=interval.low,
        high=interval.high,
        covered=int(hits[cell]) / total,
    )


def covering(cells: Cells, critical: BoolArray, most: int) -> list[Condition]:
    """Choose at most ``most`` conditions that together account for much of what is critical.

    Each step takes the condition beyond chance with the most critical futures beyond the overall share, by
    Wilson's lower limit, among futures without a condition so far.

    Source: sequential covering, Clark, Niblett 1989.
    """
    overall, left = float(np.mean(critical)) if len(critical) else 0.0, np.ones(len(critical), dtype=bool)
    every, taken = cells.sums(critical), list[Condition]()
    while len(taken) < most:
        count, hits = cells.sums(left), cells.sums(left & critical)
        gains = {
            cell: (wilson(int(hits[cell]), int(count[cell])).low - overall) * count[cell]
            for cell in _beyond_chance(count, hits, overall)
        }
        if not gains or max(gains.values()) <= 0:
            break
        best = max(gains, key=gains.__getitem__)
        taken.append(_condition(cells, best, every, int(critical.sum())))
        left &= cells.of(int(cells.group[best])) != best
    return taken
