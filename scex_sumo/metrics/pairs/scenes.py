"""A batch of scenes laid out for evaluation: vehicles and pairs first, scenes last.

With the scenes as the contiguous last axes, differences of pairs and extrema over pairs run at memory speed.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeAlias, TypeVar

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks, backward_acceleration
from scex_sumo.metrics.pairs.entries import E, Following, Known, dealt

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenes:
    """A batch of scenes; every array starts with the vehicle (V, C, T) or the pair (P, C, T).

    Pairs are unordered, ``first`` < ``second``; arrays of ordered pairs (2P) list (first, second) for all
    pairs, then (second, first).

    Attributes:
        tracks: the batch as given, history included.
        planned: current plans, for metrics that need them; None where there are none.
        parameters: constants of the metrics.
        preset: who follows whom, and what a crossing is.
        chosen: (P,) first and (P,) second vehicle of the pairs; None for all pairs.
        shared: what is made once for all children in which two tracks are the same; None for nothing.
    """

    tracks: SceneTracks
    planned: PlannedPaths | None
    parameters: MetricParameters
    preset: Preset
    chosen: tuple[IntArray, IntArray] | None = None
    shared: Shared | None = None
    _derived: dict[Callable[[Scenes], Any] | str, Any] = field(default_factory=dict, repr=False)

    def _evaluated(self, array: FloatArray) -> FloatArray:
        array = array[:, self.tracks.first :]
        if self.tracks.present is not None:
            # Absent vehicles may hold NaN; zeros keep arithmetic quiet, the masks keep them out.
            array = np.where(self.tracks.present[:, self.tracks.first :], array, 0.0)
        return np.ascontiguousarray(array.transpose(2, 0, 1))

    @property
    def vehicles(self) -> int:
        """Number of vehicles V."""
        return self.tracks.states.shape[2]

    @property
    def shape(self) -> tuple[int, int]:
        """(C, T) of the evaluated steps."""
        return self.tracks.states.shape[0], self.tracks.steps

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
        """(V, C, T) x component of the heading's direction."""
        return np.cos(self._evaluated(self.tracks.states.heading))

    @cached_property
    def sin(self) -> FloatArray:
        """(V, C, T) y component of the heading's direction."""
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

    @property
    def following(self) -> Following:
        """The car-following pairs, by the preset's rule."""
        return self.once(self.preset.leaders)

    def under(self, preset: Preset) -> Scenes:
        """The same scenes by another preset; what was derived from them is shared."""
        if preset is self.preset:
            return self
        if preset.name not in self._derived:
            other = copy.copy(self)
            object.__setattr__(other, "preset", preset)
            self._derived[preset.name] = other
        made: Scenes = self._derived[preset.name]
        return made

    def once(self, make: Callable[[Scenes], T]) -> T:
        """What ``make`` derives from these scenes, made at most once for all metrics."""
        if make not in self._derived:
            self._derived[make] = make(self)
        made: T = self._derived[make]
        return made

    def release(self) -> None:
        """Forget what was derived and knows these scenes: else the memory is free only when cycles are."""
        self._derived.clear()

    def of_pairs(self, make: Callable[[Scenes], FloatArray]) -> FloatArray:
        """(P, C, T) values that the two tracks of a pair alone decide on, made once for each two tracks."""
        if self.shared is None:
            return make(self)
        table = self.shared.scenes.under(self.preset).once(make)
        return np.take(table.reshape(len(table), -1), self.shared.row, axis=0)

    def of_ordered_pairs(self, make: Callable[[Scenes], E]) -> E:
        """Entries of ordered pairs that their two tracks alone decide on, made once for each two tracks."""
        if self.shared is None:
            return self.once(make)
        found = self.shared.scenes.under(self.preset).once(make)
        return dealt(found, self.shared.bounds(make, found.where), self.shared.row, self.shape[1])

    def at_pairs(self, values: PairValues, pair: IntArray, scene: IntArray) -> FloatArray:
        """(N,) values, likewise, of (N,) pairs in scenes given by (N,) flat index into (C, T)."""
        if self.shared is None:
            return values(self, pair, scene)
        child, step = np.divmod(scene, max(self.shape[1], 1))
        return self.shared.looked_up(values, self.shared.row[pair, child], step)

    def flat_of(self, where: IntArray) -> tuple[IntArray, IntArray]:
        """Flat indices into (V, C, T) of both vehicles of entries at flat indices into (2P, C, T)."""
        count = max(int(np.prod(self.shape)), 1)
        pair, scene = np.divmod(where, count)
        row, other = self.ordered_pairs
        return row[pair] * count + scene, other[pair] * count + scene

    def size_of(self, size: FloatArray, vehicle: IntArray, scene: IntArray) -> FloatArray:
        """(N,) of (V, C or 1, 1) sizes those of vehicles in scenes given by flat index into (C, T)."""
        of_vehicle: FloatArray = size[vehicle, scene // self.shape[1] if size.shape[1] > 1 else 0, 0]
        return of_vehicle

    def unordered(self, value: FloatArray) -> Samples:
        """Samples of a symmetric metric defined for all present pairs, from its (P, C, T) values."""
        first, second = self.pairs
        return Samples(value=value, defined=self.both_present, row=first, other=second, symmetric=True)

    def scattered(self, where: IntArray, value: FloatArray) -> Samples:
        """Samples of an ordered metric from its values at flat indices of (2P, C, T)."""
        row, other = self.ordered_pairs
        full = np.zeros((len(row), *self.shape))
        defined = np.zeros(full.shape, dtype=bool)
        full.reshape(-1)[where] = value
        defined.reshape(-1)[where] = True
        return Samples(value=full, defined=defined, row=row, other=other)


PairValues: TypeAlias = Callable[[Scenes, IntArray, IntArray], FloatArray]


def _distance(scenes: Scenes) -> FloatArray:
    return np.sqrt(scenes.dx * scenes.dx + scenes.dy * scenes.dy)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shared:
    """Pairs of tracks of several children, each that differs once.

    Attributes:
        scenes: one child with all tracks that differ and all pairs of them that are together in a child.
        row: (P, C) number of each pair of a batch of children among those.
    """

    scenes: Scenes
    row: IntArray
    _bounds: dict[Any, IntArray] = field(default_factory=dict, repr=False)
    _known: dict[Any, Known] = field(default_factory=dict, repr=False)

    def bounds(self, make: Any, where: IntArray) -> IntArray:
        """(2P + 1,) at which of ascending flat indices the entries of each ordered pair begin."""
        if make not in self._bounds:
            count = 2 * len(self.scenes.pairs[0])
            self._bounds[make] = np.searchsorted(where, np.arange(count + 1) * self.scenes.shape[1])
        return self._bounds[make]

    def looked_up(self, values: PairValues, pair: IntArray, step: IntArray) -> FloatArray:
        """(N,) values of pairs at steps, each computed when it is asked for first."""
        pairs, steps = len(self.scenes.pairs[0]), self.scenes.shape[1]
        known = self._known.setdefault(values, Known(pairs * steps))
        return known.at(pair * steps + step, lambda at: values(self.scenes, *np.divmod(at, max(steps, 1))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Nanoscopic values: a value and a mask; values where ``defined`` is False mean nothing.

    Attributes:
        value: (K, C, T) in the metric's unit; inf is a value.
        defined: (K, C, T).
        row: (K,) the vehicle whose value it is (the follower of a car-following pair).
        other: (K,) the second vehicle; None for metrics of single vehicles.
        symmetric: each unordered pair appears once and stands for both orders.
    """

    value: FloatArray
    defined: BoolArray
    row: IntArray
    other: IntArray | None
    symmetric: bool = False


@dataclass(frozen=True, kw_only=True)
class Preset:
    """What the metrics' definitions leave open.

    Attributes:
        name: as written on the command line.
        leaders: which pairs follow, and their gap.
        conflict_area: crossings are areas as wide as the vehicles, not points.
    """

    name: str
    leaders: Callable[[Scenes], Following]
    conflict_area: bool
