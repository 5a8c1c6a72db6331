"""Batch of scenes laid out for evaluation, and the values that metrics return for it."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, TypeAlias, TypeVar

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, Rows
from scex_sumo.metrics.base import PlannedPaths, SceneTracks, backward_acceleration

T = TypeVar("T")
E = TypeVar("E", bound="PairRows")


@dataclass(frozen=True, kw_only=True, eq=False)
class PairRows(Rows):
    """Rows of ordered pairs at steps."""

    where: IntArray  # (N,) flat indices into (2P, C, T), ascending


@dataclass(frozen=True, kw_only=True, eq=False)
class Entries(PairRows):
    """Nanoscopic values of ordered pairs where they are defined; inf is a value."""

    value: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Following(PairRows):
    """Car-following pairs (follower, leader) of a batch of scenes; m, m/s, m/s²."""

    gap: FloatArray
    follower_speed: FloatArray
    leader_speed: FloatArray
    leader_acceleration: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Nanoscopic values with a mask; values where ``defined`` is False mean nothing.

    Example:
        >>> scene = scex.read_seed(scex.example_path("roundabout"))
        >>> @scex.metric("haste", critical="max", unit="m/s")  # of single vehicles
        ... def haste(scenes):
        ...     vehicle = np.arange(len(scenes.speed))
        ...     there = np.ones(scenes.speed.shape, bool)
        ...     return scex.Samples(value=scenes.speed, defined=there, row=vehicle, other=None)
        >>> scex.extrapolate(scene, futures=2, metrics=["haste"]).columns
        ['haste', 'haste_mean']
    """

    value: FloatArray  # (K, C, T) in the metric's unit; inf is a value, NaN is none
    defined: BoolArray  # (K, C, T)
    row: IntArray  # (K,) vehicle of the value (the follower of a car-following pair)
    other: IntArray | None  # (K,) the second vehicle; None for metrics of single vehicles
    symmetric: bool = False  # each unordered pair appears once and stands for both orders


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenes:
    """Batch of scenes; every array starts with the vehicle (V, C, T) or the pair (P, C, T).

    Pairs are unordered. Arrays of ordered pairs (2P) list (first, second) of all pairs, then (second, first).

    Attributes:
        chosen: (P,) first and (P,) second vehicle of the pairs; None for all pairs.

    Example:
        >>> scex.Scenes.speed.__doc__
        '(V, C, T) m/s along the heading.'
    """

    tracks: SceneTracks
    planned: PlannedPaths | None  # current plans; None if there are none
    chosen: tuple[IntArray, IntArray] | None = None
    shared: TrackPairs | None = None  # values computed once for equal tracks of several futures
    near: Near | None = None  # None: all pairs are taken for near
    _derived: dict[Callable[[Scenes], Any], Any] = field(default_factory=dict, repr=False)

    def _evaluated(self, array: FloatArray) -> FloatArray:
        array = array[:, self.tracks.first :]
        if self.tracks.present is not None:
            # Absent vehicles may hold NaN; zeros keep arithmetic quiet.
            array = np.where(self.tracks.present[:, self.tracks.first :], array, 0.0)
        return np.ascontiguousarray(array.transpose(2, 0, 1))

    @property
    def vehicles(self) -> int:
        """V."""
        return self.tracks.states.shape[2]

    @property
    def shape(self) -> tuple[int, int]:
        """(C, T) of the evaluated steps."""
        return self.tracks.states.shape[0], self.tracks.steps

    @property
    def count(self) -> int:
        """Number of scenes, C times T; 1 for none, because flat indices are divided by it."""
        return max(self.shape[0] * self.shape[1], 1)

    @cached_property
    def x(self) -> FloatArray:
        """(V, C, T) m."""
        return self._evaluated(self.tracks.states.x)

    @cached_property
    def y(self) -> FloatArray:
        """(V, C, T) m."""
        return self._evaluated(self.tracks.states.y)

    @cached_property
    def speed(self) -> FloatArray:
        """(V, C, T) m/s along the heading."""
        return self._evaluated(self.tracks.states.speed)

    @cached_property
    def cos(self) -> FloatArray:
        """(V, C, T) of the heading."""
        return np.cos(self._evaluated(self.tracks.states.heading))

    @cached_property
    def sin(self) -> FloatArray:
        """(V, C, T) of the heading."""
        return np.sin(self._evaluated(self.tracks.states.heading))

    @cached_property
    def present(self) -> BoolArray:
        """(V, C, T)."""
        if self.tracks.present is None:
            return np.ones((self.vehicles, *self.shape), dtype=bool)
        return np.ascontiguousarray(self.tracks.present[:, self.tracks.first :].transpose(2, 0, 1))

    @cached_property
    def all_acceleration(self) -> FloatArray:
        """(C, T_all, V) m/s², history included."""
        if self.tracks.acceleration is not None:
            return self.tracks.acceleration
        speed = self.tracks.states.speed
        if self.tracks.present is not None:
            speed = np.where(self.tracks.present, speed, 0.0)
        return backward_acceleration(speed, self.tracks.present, self.tracks.step_s)

    @cached_property
    def acceleration(self) -> FloatArray:
        """(V, C, T) m/s²."""
        return self._evaluated(self.all_acceleration)

    @cached_property
    def length(self) -> FloatArray:
        """(V, C or 1, 1) m."""
        return np.atleast_2d(self.tracks.length).T[:, :, None]

    @cached_property
    def width(self) -> FloatArray:
        """(V, C or 1, 1) m."""
        return np.atleast_2d(self.tracks.width).T[:, :, None]

    @cached_property
    def pairs(self) -> tuple[IntArray, IntArray]:
        """(P,) first and (P,) second vehicle of every unordered pair."""
        if self.chosen is not None:
            return self.chosen
        first, second = np.triu_indices(self.vehicles, 1)
        return first.astype(np.int64), second.astype(np.int64)

    @cached_property
    def ordered_pairs(self) -> tuple[IntArray, IntArray]:
        """(2P,) the row's own vehicle and (2P,) the other."""
        first, second = self.pairs
        return np.concatenate([first, second]), np.concatenate([second, first])

    @cached_property
    def both_present(self) -> BoolArray:
        """(P, C, T)."""
        first, second = self.pairs
        return self.present[first] & self.present[second]

    @cached_property
    def dx(self) -> FloatArray:
        """(P, C, T) second minus first, m."""
        return self.x[self.pairs[1]] - self.x[self.pairs[0]]

    @cached_property
    def dy(self) -> FloatArray:
        """(P, C, T) second minus first, m."""
        return self.y[self.pairs[1]] - self.y[self.pairs[0]]

    @cached_property
    def distance(self) -> FloatArray:
        """(P, C, T) between centres, m."""
        return self.of_pairs(_distance)

    def of_vehicles(self, vehicles: Collection[int]) -> Scenes:
        """Return the same scenes with those pairs only that one of these vehicles (indices) is in."""
        own = np.flatnonzero(np.isin(self.pairs, list(vehicles)).any(axis=0))
        shared = None if self.shared is None else replace(self.shared, row=self.shared.row[own])
        scenes, near = self.of_pair_numbers(own, shared), self.near
        if near is None:
            return scenes
        pair = np.searchsorted(own, near.pair[np.isin(near.pair, own)])
        near = Near(scenes=near.scenes.of_vehicles(vehicles), pair=pair, apart=near.apart[own])
        return replace(scenes, near=near)

    def of_pair_numbers(self, pairs: IntArray, shared: TrackPairs | None = None) -> Scenes:
        """Return the same scenes with some pairs, by number, whose values are ``shared``."""
        first, second = self.pairs
        chosen = first[pairs], second[pairs]
        return replace(self, chosen=chosen, shared=shared, near=None, _derived={})

    def once(self, make: Callable[[Scenes], T]) -> T:
        """Return ``make(self)``, computed once for all metrics."""
        if make not in self._derived:
            self._derived[make] = make(self)
        derived: T = self._derived[make]
        return derived

    def release(self) -> None:
        """Drop derived values, because reference cycles keep the memory."""
        self._derived.clear()
        if self.near is not None:
            self.near.scenes.release()

    def of_pairs(self, make: Callable[[Scenes], FloatArray]) -> FloatArray:
        """Return (P, C, T) values that depend on a pair's two tracks only."""
        if self.shared is None:
            return make(self)
        table = self.shared.scenes.once(make)
        return np.take(table.reshape(len(table), -1), self.shared.row, axis=0)

    def of_ordered_pairs(self, make: Callable[[Scenes], E]) -> E:
        """Return rows that depend on an ordered pair's two tracks only."""
        if self.shared is None:
            return self.once(make)
        return self.shared.per_future(make, self.shared.scenes.once(make))

    def of_near_pairs(self, make: Callable[[Scenes], E]) -> E:
        """Return rows of `of_ordered_pairs` that only near pairs can have."""
        if self.near is None:
            return self.of_ordered_pairs(make)
        rows = self.near.scenes.of_ordered_pairs(make)
        number, scene = np.divmod(rows.where, self.count)
        ordered = np.concatenate([self.near.pair, self.near.pair + len(self.pairs[0])])
        return replace(rows, where=ordered[number] * self.count + scene)

    def at_pairs(self, values: PairValues, pair: IntArray, scene: IntArray) -> FloatArray:
        """Return (N,) values of pairs in scenes given by flat index into (C, T)."""
        if self.shared is None:
            return values(self, pair, scene)
        future, step = np.divmod(scene, max(self.shape[1], 1))
        return self.shared.at(values, self.shared.row[pair, future], step)

    def of_some_pairs(self, values: PairValues, wanted: BoolArray | None = None) -> Samples:
        """Return samples of the (P, C, T) wanted pairs; None: of all."""
        table: FloatArray = np.zeros((len(self.pairs[0]), *self.shape))
        places = np.arange(table.size) if wanted is None else np.flatnonzero(wanted)
        table.reshape(-1)[places] = self.at_pairs(values, *np.divmod(places, self.count))
        samples = self.unordered(table)
        return samples if wanted is None else replace(samples, defined=wanted)

    def flat_of(self, where: IntArray) -> tuple[IntArray, IntArray]:
        """Convert flat indices into (2P, C, T) to those of both vehicles into (V, C, T)."""
        pair, scene = np.divmod(where, self.count)
        own, other = self.ordered_pairs
        return own[pair] * self.count + scene, other[pair] * self.count + scene

    def size_of(self, size: FloatArray, vehicle: IntArray, scene: IntArray) -> FloatArray:
        """Pick (N,) sizes from (V, C or 1, 1) by vehicle and flat index into (C, T)."""
        of_vehicle: FloatArray = size[vehicle, scene // self.shape[1] if size.shape[1] > 1 else 0, 0]
        return of_vehicle

    def unordered(self, value: FloatArray) -> Samples:
        """Return samples of a symmetric metric defined for all present pairs, from (P, C, T) values."""
        first, second = self.pairs
        return Samples(value=value, defined=self.both_present, row=first, other=second, symmetric=True)

    def scattered(self, where: IntArray, value: FloatArray) -> Samples:
        """Return samples of an ordered metric, from values at flat indices into (2P, C, T)."""
        row, other = self.ordered_pairs
        table = np.zeros((len(row), *self.shape))
        defined = np.zeros(table.shape, dtype=np.bool_)
        table.reshape(-1)[where] = value
        defined.reshape(-1)[where] = True
        return Samples(value=table, defined=defined, row=row, other=other)


PairValues: TypeAlias = Callable[[Scenes, IntArray, IntArray], FloatArray]


def _distance(scenes: Scenes) -> FloatArray:
    return np.sqrt(scenes.dx * scenes.dx + scenes.dy * scenes.dy)


@dataclass(frozen=True, kw_only=True, eq=False)
class Near:
    """Near pairs of a batch of scenes, see `scex_sumo.metrics.pairs.near.near_pairs`."""

    scenes: Scenes  # the same scenes with these pairs only
    pair: IntArray  # (P',) their numbers among all, ascending
    apart: FloatArray  # (P,) distance that the centres of each pair never fall below, m


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackPairs:
    """Different pairs of tracks of several futures; values of a pair are computed once."""

    scenes: Scenes  # one future with all different tracks, and the pairs of them that occur in a future
    row: IntArray  # (P, C) number of each pair of vehicles among those pairs
    _bounds: dict[Any, IntArray] = field(default_factory=dict, repr=False)
    _values: dict[Any, tuple[FloatArray, BoolArray]] = field(default_factory=dict, repr=False)

    def of_futures(self, futures: slice) -> TrackPairs:
        """Return the same pairs of tracks for some futures."""
        return replace(self, row=self.row[:, futures])

    def per_future(self, make: Any, rows: E) -> E:
        """Repeat rows, made by ``make``, for all futures that contain the pair."""
        steps = self.scenes.shape[1]
        pairs = len(self.scenes.pairs[0])
        if make not in self._bounds:  # where the rows of each ordered pair begin
            self._bounds[make] = np.searchsorted(rows.where, np.arange(2 * pairs + 1) * steps)
        bounds = self._bounds[make]
        ordered = np.concatenate([self.row, self.row + pairs]).reshape(-1)
        begin = bounds[ordered]
        count = bounds[ordered + 1] - begin
        filled = np.flatnonzero(count)
        begin, count = begin[filled], count[filled]
        entry = np.arange(count.sum()) + np.repeat(begin - np.cumsum(count) + count, count)
        arrays = {f.name: getattr(rows, f.name)[entry] for f in fields(rows)}
        arrays["where"] = np.repeat(filled * steps, count) + arrays["where"] % max(steps, 1)
        return replace(rows, **arrays)

    def at(self, values: PairValues, pair: IntArray, step: IntArray) -> FloatArray:
        """Return (N,) values of pairs of tracks; each is computed once."""
        size, steps = len(self.scenes.pairs[0]) * self.scenes.shape[1], max(self.scenes.shape[1], 1)
        table, computed = self._values.setdefault(values, (np.empty(size), np.zeros(size, dtype=bool)))
        index = pair * self.scenes.shape[1] + step
        new = np.zeros(size, dtype=bool)
        new[index] = True
        missing = np.flatnonzero(new & ~computed)
        table[missing] = values(self.scenes, *np.divmod(missing, steps))
        computed[missing] = True
        picked: FloatArray = table[index]
        return picked
