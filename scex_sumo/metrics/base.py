"""Tracks and planned paths as criticality metrics take them, and the metrics' constants.

Axes: C (child), T (step), V (vehicle), R (replan), H (planned step), K (ordered or unordered pairs, or
vehicles).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.errors import InputError
from scex_sumo.scene import STEP_S, States


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
class SceneTracks:
    """What the vehicles of C children (or recordings) did.

    Attributes:
        states: (C, T, V) as driven; anything where ``present`` is False.
        length: (V,) or (C, V) m.
        width: (V,) or (C, V) m.
        present: (C, T, V) False where a vehicle is not on the scene; None where all are always.
        step_s: time between two steps, s.
        first: steps before it are history: used for derived values (acceleration, the 2 s of TQ), never
            evaluated.
        types: (V,) or (C, V) lower case, for limits that depend on the type; None where unknown.
        acceleration: (C, T, V) m/s², for parts of longer tracks; None derives it from these steps.
    """

    states: States
    length: FloatArray
    width: FloatArray
    present: BoolArray | None = None
    step_s: float = STEP_S
    first: int = 0
    types: tuple[str, ...] | NDArray[np.str_] | None = None
    acceleration: FloatArray | None = None

    def __post_init__(self) -> None:
        shape = self.states.shape
        if len(shape) != 3:
            raise InputError(f"tracks to evaluate: states have shape {shape}; pass (child, step, vehicle)")
        if not 0 <= self.first <= shape[1]:
            raise InputError(
                f"tracks to evaluate: first step {self.first} is not within the {shape[1]} steps"
            )
        if self.present is not None and self.present.shape != shape:
            raise InputError(f"tracks to evaluate: `present` is {self.present.shape}, the states are {shape}")
        for name, size in (("length", self.length), ("width", self.width)):
            if size.shape not in ((shape[2],), (shape[0], shape[2])):
                raise InputError(
                    f"tracks to evaluate: {name} has shape {size.shape}; pass ({shape[2]},) or "
                    f"({shape[0]}, {shape[2]}) for {shape[0]} children of {shape[2]} vehicles"
                )
        self._check_finite()

    def _check_finite(self) -> None:
        for name in ("x", "y", "heading", "speed"):
            bad = ~np.isfinite(getattr(self.states, name))
            if self.present is not None:
                bad &= self.present
            if bad.any():
                child, step, vehicle = (int(i) for i in np.argwhere(bad)[0])
                raise InputError(
                    f"tracks to evaluate: {name} of vehicle {vehicle} in child {child} at step {step} is not "
                    f"a finite number ({int(bad.sum())} such values); mark it as not present"
                )

    @property
    def steps(self) -> int:
        """Number of evaluated steps."""
        return self.states.shape[1] - self.first

    def children(self, part: slice) -> SceneTracks:
        """The same for some of the children."""
        per_child, types = (self.length.ndim == 2, self.width.ndim == 2), self.types
        return SceneTracks(
            states=self.states[part],
            length=self.length[part] if per_child[0] else self.length,
            width=self.width[part] if per_child[1] else self.width,
            present=None if self.present is None else self.present[part],
            step_s=self.step_s,
            first=self.first,
            types=types[part] if isinstance(types, np.ndarray) and types.ndim == 2 else types,
            acceleration=None if self.acceleration is None else self.acceleration[part],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedPaths:
    """Path of the current plan of every vehicle at every evaluated step.

    The planned path at a step starts at the vehicle's present position and goes on through the columns of the
    current plan that are still ahead. A recording is its own plan: one plan that holds the whole track.

    Attributes:
        x: (C, R, V, H) centre, m; NaN where there is no plan, gaps are bridged by straight lines.
        y: (C, R, V, H) centre, m.
        index: (T,) which of the R plans is current at each evaluated step.
        column: (T,) first column of that plan that is still ahead; H where none is.
        driven: the plan is the track itself, one column per step.
    """

    x: FloatArray
    y: FloatArray
    index: IntArray
    column: IntArray
    driven: bool = False

    def __post_init__(self) -> None:
        if self.x.ndim != 4 or self.x.shape != self.y.shape:
            raise InputError(
                f"planned paths: x is {self.x.shape} and y {self.y.shape}; pass both as "
                "(child, replan, vehicle, planned step)"
            )
        if self.index.shape != self.column.shape or self.index.ndim != 1:
            raise InputError(
                f"planned paths: index is {self.index.shape}, column {self.column.shape}; pass one per step"
            )
        if np.any((self.index < 0) | (self.index >= max(self.x.shape[1], 1))) or np.any(self.column < 0):
            raise InputError(
                f"planned paths: index or column points outside the {self.x.shape[1]} plans of "
                f"{self.x.shape[3]} columns"
            )

    @classmethod
    def from_replans(cls, x: FloatArray, y: FloatArray, made_at: IntArray, steps: int) -> PlannedPaths:
        """Plans made during a run; the newest plan is the current one.

        Args:
            x: (C, R, V, H) m; column 0 is the step after the plan was made.
            y: (C, R, V, H) m.
            made_at: (R,) number of the step at which each plan was made, 0 for the seed scene, ascending.
            steps: number of simulated steps; the evaluated steps are 1 to ``steps``.
        """
        step = np.arange(1, steps + 1)
        index = np.searchsorted(made_at, step, side="right") - 1
        column = np.minimum(step - np.asarray(made_at)[index], x.shape[3])
        return cls(x=x, y=y, index=index.astype(np.int64), column=column.astype(np.int64))

    @classmethod
    def from_tracks(cls, tracks: SceneTracks) -> PlannedPaths:
        """The track driven from each step on, for recordings."""
        x, y = tracks.states.x, tracks.states.y
        if tracks.present is not None:
            x, y = np.where(tracks.present, x, np.nan), np.where(tracks.present, y, np.nan)
        return cls(
            x=x.transpose(0, 2, 1)[:, None],
            y=y.transpose(0, 2, 1)[:, None],
            index=np.zeros(tracks.steps, dtype=np.int64),
            column=np.arange(tracks.first + 1, tracks.first + tracks.steps + 1),
            driven=True,
        )

    def check_fit(self, tracks: SceneTracks) -> None:
        """Raise an `InputError` where these are not the paths of the vehicles and steps of some tracks."""
        children, _, vehicles = tracks.states.shape
        if (self.x.shape[0], self.x.shape[2]) != (children, vehicles) or self.index.shape != (tracks.steps,):
            raise InputError(
                f"planned paths are of {self.x.shape[0]} children, {self.x.shape[2]} vehicles and "
                f"{self.index.size} steps, the tracks of {children}, {vehicles} and {tracks.steps} evaluated "
                "steps; pass matching ones"
            )

    def children(self, part: slice) -> PlannedPaths:
        """The same for some of the children."""
        return replace(self, x=self.x[part], y=self.y[part])


@dataclass(frozen=True, kw_only=True)
class MetricParameters:
    """Constants of the metrics; the defaults are the paper's.

    Attributes:
        following_angle: largest difference of headings of a car-following pair, rad.
        max_acceleration: of one vehicle in any direction, for WTTC, m/s².
        max_acceleration_by_type: the same for vehicle types that differ, e.g. ``{"truck": 4.0}``.
        standing_speed: at or below it a vehicle never reaches a crossing (gap time) or the position of
            its leader (time headway), m/s.
        path_extension: how far planned paths go on straight beyond their end when preset ``path`` looks for
            leaders, m, at least.
        path_extension_time: the same as a time at present speed, s; the longer one counts.
    """

    following_angle: float = np.pi / 6
    max_acceleration: float = 6.9
    max_acceleration_by_type: Mapping[str, float] = field(default_factory=dict)
    standing_speed: float = 1e-4
    path_extension: float = 20.0
    path_extension_time: float = 2.0

    def __post_init__(self) -> None:
        if not 0 <= self.following_angle <= np.pi:
            raise InputError(
                f"metrics: following angle {self.following_angle} rad; choose one within 0 to pi"
            )
        for name, limit in {"any": self.max_acceleration, **self.max_acceleration_by_type}.items():
            if not (np.isfinite(limit) and limit >= 0):
                raise InputError(
                    f"metrics: largest acceleration of type {name!r} is {limit}; choose one >= 0"
                )
        if not self.standing_speed >= 0:
            raise InputError(f"metrics: standing speed {self.standing_speed} m/s; choose one >= 0")
        if not (np.isfinite(self.path_extension) and self.path_extension > 0):
            raise InputError(f"metrics: path extension {self.path_extension} m; choose one above 0")
        if not (np.isfinite(self.path_extension_time) and self.path_extension_time >= 0):
            raise InputError(f"metrics: path extension {self.path_extension_time} s; choose one >= 0")

    def accelerations(self, types: tuple[str, ...] | NDArray[np.str_] | None, vehicles: int) -> FloatArray:
        """(V,) or (C, V) largest acceleration of each vehicle, m/s²."""
        if types is None:
            return np.full(vehicles, self.max_acceleration)
        names, which = np.unique(np.asarray(types), return_inverse=True)
        limits = [self.max_acceleration_by_type.get(str(name), self.max_acceleration) for name in names]
        return np.array(limits, dtype=float)[which.reshape(np.shape(types))]


PAPER: Final = MetricParameters()
