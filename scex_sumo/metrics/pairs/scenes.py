"""A batch of scenes laid out for evaluation: vehicles and pairs first, scenes last.

With the scenes as the contiguous last axes, differences of pairs and extrema over pairs run at memory speed.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks

T = TypeVar("T")


def backward_acceleration(speed: FloatArray, present: BoolArray | None, step_s: float) -> FloatArray:
    """Backward difference of the speed over the time since a vehicle's previous sample.

    Args:
        speed: (C, T, V) m/s.
        present: (C, T, V) where the vehicle was seen; None for everywhere.
        step_s: time between two steps, s.

    Returns:
        (C, T, V) m/s²; 0 for the first sample of a track and where a vehicle is not present.
    """
    change = np.zeros_like(speed)
    if present is None:
        change[:, 1:] = (speed[:, 1:] - speed[:, :-1]) / step_s
        return change
    step = np.broadcast_to(np.arange(speed.shape[1])[:, None], speed.shape)
    last_seen = np.maximum.accumulate(np.where(present, step, -1), axis=1)
    previous = np.full(speed.shape, -1)
    previous[:, 1:] = last_seen[:, :-1]
    has_previous = present & (previous >= 0)
    before = np.take_along_axis(speed, np.maximum(previous, 0), axis=1)
    elapsed = np.where(has_previous, step - previous, 1) * step_s
    np.divide(speed - before, elapsed, out=change, where=has_previous)
    return change


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
    """

    tracks: SceneTracks
    planned: PlannedPaths | None
    parameters: MetricParameters
    preset: Preset
    _derived: dict[Callable[[Scenes], Any], Any] = field(default_factory=dict, repr=False)

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
        return np.sqrt(self.dx * self.dx + self.dy * self.dy)

    @property
    def following(self) -> Following:
        """The car-following pairs, by the preset's rule."""
        return self.once(self.preset.leaders)

    def under(self, preset: Preset) -> Scenes:
        """The same scenes by another preset; what was derived from them is shared."""
        if preset is self.preset:
            return self
        other = copy.copy(self)
        object.__setattr__(other, "preset", preset)
        return other

    def once(self, make: Callable[[Scenes], T]) -> T:
        """What ``make`` derives from these scenes, made at most once for all metrics."""
        if make not in self._derived:
            self._derived[make] = make(self)
        made: T = self._derived[make]
        return made

    def release(self) -> None:
        """Forget what was derived and knows these scenes: else the memory is free only when cycles are."""
        self._derived.clear()

    def ordered_index(self, row: IntArray, other: IntArray) -> IntArray:
        """(N,) number of each ordered pair of vehicles in the order of ``ordered_pairs``."""
        number = np.zeros((self.vehicles, self.vehicles), dtype=np.int64)
        number[self.ordered_pairs] = np.arange(self.vehicles * (self.vehicles - 1))
        return number[row, other]

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Following:
    """All F car-following pairs of a batch of scenes.

    Attributes:
        where: (F,) flat indices into (2P, C, T) of ordered pairs (follower, leader), ascending.
        gap: (F,) distance from follower to leader, m.
        follower_speed: (F,) m/s.
        leader_speed: (F,) m/s.
        leader_acceleration: (F,) m/s².
    """

    where: IntArray
    gap: FloatArray
    follower_speed: FloatArray
    leader_speed: FloatArray
    leader_acceleration: FloatArray
