"""Influence tables: an event's outcome for every assignment of the vehicles that decide it.

P is the sum of the cells in which the event happens, each weighted by the product of its vehicles' shares: a
polynomial of the shares, so that other weights need no new futures.

Source: minimal cut sets as in fault trees (Vesely et al. 1981).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from typing import TypeAlias

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.statistics.bands import remainder_of

Cube: TypeAlias = frozenset[tuple[int, int]]
"""Partial assignment: track ids and the indices of their models."""
Weights: TypeAlias = Mapping[str, float] | Mapping[int, Mapping[str, float]]
"""Weights by model, for all vehicles; or by track id and model, for some of them."""

MAX_SPLITS = 200_000  # of the recursion over the union of events

WORDS: Mapping[str, str] = {
    "constant_velocity": "keeps its speed",
    "emergency_brake": "brakes hard",
    "standard_driver": "drives calmly",
    "risky_driver": "drives riskily",
    "replay": "drives as recorded",
    "runs_red": "runs red",
    "ignores_priority": "ignores priority",
    "cuts_in": "cuts in",
    "drifts": "drifts out of its lane",
    "steps_out": "steps out",
    "stops": "stops",
    "keeps_way": "keeps its way",
}
"""What a vehicle or person does under a model, for cut sets in words."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Draws:
    """Models that the vehicles and the people of a run draw.

    Attributes:
        models: the M models.
        shares: (M,) share of each among those of vehicles, or among those of people.
        people: track ids of the people that draw.
        of_people: the models that they draw; vehicles draw the others.
    """

    models: tuple[str, ...]
    shares: FloatArray
    people: frozenset[int] = frozenset()
    of_people: frozenset[str] = frozenset()

    @classmethod
    def of(
        cls, of_vehicles: Mapping[str, float], of_people: Mapping[str, float], people: Iterable[int]
    ) -> Draws:
        """Build from weights by model; people draw only if they have models."""
        groups = [group for group in (of_vehicles, of_people) if group]
        return cls(
            models=(*of_vehicles, *of_people),
            shares=np.concatenate([np.array([*group.values()]) / sum(group.values()) for group in groups]),
            people=frozenset(people if of_people else ()),
            of_people=frozenset(of_people),
        )

    def own(self, track: int) -> BoolArray:
        """Return (M,) whether a vehicle or person draws each model."""
        return np.array([(name in self.of_people) == (track in self.people) for name in self.models])

    def shares_of(self, track_ids: Iterable[int], weights: Weights | None = None) -> dict[int, FloatArray]:
        """Return the share of each model by track id.

        Args:
            weights: by model, for all that draw it; or by track id, then model. Models that are not named
                share what is left to 1, in proportion to the run's; they get none if the named ones sum to 1
                or more.

        Raises:
            UsageError: an unknown model, a weight below 0, or nothing above 0.
        """
        given = dict(weights or {})
        each = {int(key): value for key, value in given.items() if isinstance(value, Mapping)}
        common = {str(key): float(value) for key, value in given.items() if not isinstance(value, Mapping)}
        _check_known(common, self.models)
        return {track: self._weighted(self.own(track), each.get(track), common) for track in track_ids}

    def _weighted(
        self, own: BoolArray, given: Mapping[str, float] | None, common: Mapping[str, float]
    ) -> FloatArray:
        drawn = [name for name, mine in zip(self.models, own, strict=True) if mine]
        if given is None:
            given = {name: weight for name, weight in common.items() if name in drawn}
        shares = np.zeros(len(own))
        shares[own] = _normed(given, drawn, self.shares[own])
        return shares


@dataclass(frozen=True, kw_only=True, eq=False)
class InfluenceTable:
    """Outcome of one event for every assignment of its influence set.

    Attributes:
        track_ids: the k vehicles of the influence set, ascending.
        draws: the M models that they draw from, and their shares in the run.
        outcomes: (M, ..., M) with k axes: whether the event happens; with a model that a vehicle does not
            draw, whether it happens with all that it draws.
        checked: number of independently drawn futures that the table predicted without a difference.
    """

    track_ids: tuple[int, ...]
    draws: Draws
    outcomes: BoolArray
    checked: int

    @classmethod
    def of_cubes(
        cls,
        cubes: Iterable[Mapping[int, int]],
        track_ids: Sequence[int],
        draws: Draws,
        checked: int,
    ) -> InfluenceTable:
        """Build a table from partial assignments, level by track id, under which the event happens."""
        outcomes = np.zeros((len(draws.models),) * len(track_ids), dtype=np.bool_)
        for cube in cubes:
            outcomes[tuple(cube.get(track, slice(None)) for track in track_ids)] = True
        for axis, track in enumerate(track_ids):
            if not (own := draws.own(track)).all():
                by_model = np.moveaxis(outcomes, axis, 0)
                by_model[~own] = by_model[own].all(axis=0)
        return cls(track_ids=tuple(track_ids), draws=draws, outcomes=outcomes, checked=checked)

    @property
    def remainder(self) -> float:
        """Share of assignments that the table may get wrong, at most, with 95 %; see `remainder_of`."""
        return remainder_of(self.checked)

    def summary(self) -> str:
        """Return how the table was checked, in words."""
        return f"exact, checked on {self.checked} futures: none differs (remainder {self.remainder:.1%})"

    def probability(self, weights: Weights | None = None) -> float:
        """Return the exact probability of the event.

        Args:
            weights: as of `Draws.shares_of`; None for the run's.
        """
        return self._sum(self.draws.shares_of(self.track_ids, weights))

    def leverage(self, weights: Weights | None = None) -> dict[int, dict[str, float]]:
        """Return the derivative of P with respect to each vehicle's share of each model.

        The vehicle's other models give way in proportion; 0 for the only model of a vehicle.
        """
        shares, models = self.draws.shares_of(self.track_ids, weights), self.draws.models
        whole, leverage = self._sum(shares), dict[int, dict[str, float]]()
        for track in self.track_ids:
            leverage[track] = {}
            for index in np.flatnonzero(self.draws.own(track)).tolist():
                rest = 1.0 - float(shares[track][index])
                only = {**shares, track: np.eye(len(models))[index]}
                leverage[track][models[index]] = (self._sum(only) - whole) / rest if rest > 1e-12 else 0.0
        return leverage

    def _sum(self, shares: Mapping[int, FloatArray]) -> float:
        value = self.outcomes.astype(np.float64)
        for track in reversed(self.track_ids):
            value = value @ shares[track]
        return float(value)

    @cached_property
    def cut_sets(self) -> tuple[Cube, ...]:
        """Minimal partial assignments under which the event happens whatever the others do."""
        cubes: list[Cube] = []
        axes = range(len(self.track_ids))
        always: dict[tuple[int, ...], BoolArray] = {}
        for size in range(len(self.track_ids) + 1):
            for kept in combinations(axes, size):
                here = np.asarray(self.outcomes.all(axis=tuple(a for a in axes if a not in kept)))
                always[kept], minimal = here, here.copy()
                for at in range(size):
                    minimal &= ~np.expand_dims(always[kept[:at] + kept[at + 1 :]], at)
                cubes += [
                    frozenset((self.track_ids[a], level) for a, level in zip(kept, cell, strict=True))
                    for cell in np.argwhere(minimal).tolist()
                ]
        return tuple(cubes)

    def in_words(self) -> list[str]:
        """Return the cut sets in words; those that differ in one vehicle's model are one phrase."""
        sets = [{track: {level} for track, level in cube} for cube in self.cut_sets]
        joined = True
        while joined:
            joined = False
            for one, two in combinations(range(len(sets)), 2):
                differ = [track for track in sets[one] if sets[one][track] != sets[two].get(track)]
                if sets[one].keys() == sets[two].keys() and len(differ) == 1:
                    sets[one][differ[0]] |= sets[two][differ[0]]
                    del sets[two]
                    joined = True
                    break
        return [self._phrase(one) for one in sets]

    def _phrase(self, cube: Mapping[int, Iterable[int]]) -> str:
        models, parts = self.draws.models, []
        for track, shares in self.draws.shares_of(self.track_ids).items():
            if track in cube:
                drawn = set(np.flatnonzero(shares).tolist())
                others = sorted(drawn - set(cube[track]))
                if len(drawn) > 2 and len(others) == 1:
                    parts.append(f"{track} {_does_not(models[others[0]])}")
                else:
                    parts.append(f"{track} {' or '.join(_does(models[k]) for k in sorted(cube[track]))}")
        return " and ".join(parts) or "whatever its drivers do"


def _does(model: str) -> str:
    return f"{WORDS[model]} ({model})" if model in WORDS else f"drives as {model}"


def _does_not(model: str) -> str:
    verb, _, rest = WORDS.get(model, f"drives as {model}").partition(" ")
    return f"does not {verb.removesuffix('s')} {rest}".rstrip()


def reduced(table: InfluenceTable) -> InfluenceTable:
    """Return a table without the vehicles whose model changes nothing."""
    keep, outcomes = list(table.track_ids), table.outcomes
    for axis in reversed(range(len(keep))):
        first = np.take(outcomes, [0], axis=axis)
        if (outcomes == first).all():
            outcomes = first.squeeze(axis=axis)
            del keep[axis]
    outcomes = np.asarray(outcomes, dtype=np.bool_)
    return InfluenceTable(track_ids=tuple(keep), draws=table.draws, outcomes=outcomes, checked=table.checked)


def _check_known(weights: Mapping[str, float], models: Sequence[str]) -> None:
    unknown = [name for name in weights if name not in models]
    if unknown:
        raise UsageError(f"weights: unknown model {unknown[0]!r}; the run draws {', '.join(models)}")


def _normed(weights: Mapping[str, float], models: Sequence[str], shares: FloatArray) -> FloatArray:
    if not weights:
        return np.asarray(shares, dtype=np.float64)
    _check_known(weights, models)
    bad = [name for name, weight in weights.items() if not (math.isfinite(weight) and weight >= 0)]
    if bad:
        raise UsageError(f"weights: {bad[0]}={weights[bad[0]]}: needs 0 or more")
    given = np.array([weights.get(name, 0.0) for name in models], dtype=np.float64)
    rest = np.array([0.0 if name in weights else s for name, s in zip(models, shares, strict=True)])
    if rest.sum() > 0 and given.sum() < 1:
        given += rest * (1 - given.sum()) / rest.sum()
    if given.sum() <= 0:
        raise UsageError("weights: all are 0; give at least one model a positive weight")
    return np.asarray(given / given.sum())


def union_probability(tables: Sequence[InfluenceTable], weights: Weights | None = None) -> float | None:
    """Return the exact probability that any of several events happens; None if it takes too long.

    Events without common vehicles are independent: 1 - prod(1 - P). Connected ones are split by the vehicle
    that most cut sets name.
    """
    shares: dict[int, FloatArray] = {}
    for table in tables:
        shares |= table.draws.shares_of(table.track_ids, weights)
    cubes = frozenset(cube for table in tables for cube in table.cut_sets)
    splits = 0

    @cache
    def any_of(cubes: frozenset[Cube]) -> float:
        nonlocal splits
        if not cubes:
            return 0.0
        if frozenset() in cubes:
            return 1.0
        parts = _connected(cubes)
        if len(parts) > 1:
            return 1.0 - math.prod(1.0 - any_of(part) for part in parts)
        splits += 1
        if splits > MAX_SPLITS:
            raise RecursionError
        count: dict[int, int] = {}
        for cube in cubes:
            for track, _ in cube:
                count[track] = count.get(track, 0) + 1
        track = max(sorted(count), key=count.__getitem__)
        total = 0.0
        for level, share in enumerate(shares[track].tolist()):
            if share > 0:
                total += share * any_of(_given(cubes, track, level))
        return total

    try:
        return any_of(cubes)
    except RecursionError:
        return None


def _given(cubes: frozenset[Cube], track: int, level: int) -> frozenset[Cube]:
    """Return what is left of cubes if a vehicle has a model."""
    mine = {(track, level)}
    return frozenset(c - mine for c in cubes if all(t != track or k == level for t, k in c))


def _connected(cubes: frozenset[Cube]) -> list[frozenset[Cube]]:
    """Return groups of cubes that share no vehicle."""
    groups: list[tuple[set[int], list[Cube]]] = []
    for cube in cubes:
        tracks, members = {track for track, _ in cube}, [cube]
        apart = []
        for others, theirs in groups:
            if others & tracks:
                tracks |= others
                members += theirs
            else:
                apart.append((others, theirs))
        groups = [*apart, (tracks, members)]
    return [frozenset(members) for _, members in groups]
