"""Tracks and planned paths as input of metrics, and the metrics' constants.

Axes: C (future), T (step), V (vehicle), R (replan), H (planned step), P (unordered pairs), N (rows).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import InputError
from scex_sumo.scene import STEP_S, States

MAX_MAGNITUDE: Final = 1e12
"""Largest coordinate, heading, speed or size; squares of larger ones may overflow."""

FOLLOWING_RAD: Final = np.pi / 6
"""Largest difference of headings of a car-following pair."""
MAX_ACCELERATION: Final = 6.9
"""Of one vehicle in any direction, for WTTC, m/s²."""
STANDING_MPS: Final = 1e-4
"""Up to it a vehicle has no gap time and no time headway."""
EXTENSION_M, EXTENSION_S = 20.0, 2.0
"""Straight extension of planned paths in the search for leaders; the longer one, at present speed, counts."""


def backward_acceleration(speed: FloatArray, present: BoolArray | None, step_s: float) -> FloatArray:
    """Return (C, T, V) backward differences of the speed, m/s²; 0 for first samples and absent vehicles."""
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
    """Tracks of the vehicles of C futures or recordings."""

    states: States  # (C, T, V); any value where ``present`` is False
    length: FloatArray  # (V,) or (C, V) m; ``width`` too
    width: FloatArray
    present: BoolArray | None = None  # (C, T, V); None if all vehicles are always present
    step_s: float = STEP_S
    first: int = 0  # number of history steps, which are not evaluated
    types: tuple[str, ...] | NDArray[np.str_] | None = None  # (V,) or (C, V) lower case; None if unknown
    acceleration: FloatArray | None = None  # (C, T, V) m/s²; None derives it from these steps

    def __post_init__(self) -> None:
        for name, size in (("length", self.length), ("width", self.width)):
            if not np.all((size >= 0) & (size <= MAX_MAGNITUDE)):
                raise InputError(
                    f"tracks to evaluate: a {name} is not within 0 to {MAX_MAGNITUDE:g} m; repair it"
                )
        for name in ("x", "y", "heading", "speed"):
            bad = ~(np.abs(getattr(self.states, name)) <= MAX_MAGNITUDE)
            if self.present is not None:
                bad &= self.present
            if bad.any():
                future, step, vehicle = (int(i) for i in np.argwhere(bad)[0])
                raise InputError(
                    f"tracks to evaluate: {name} of vehicle {vehicle} in future {future} at step {step} is "
                    f"not a finite number up to {MAX_MAGNITUDE:g} ({int(bad.sum())} such values); "
                    "mark it as not present"
                )

    @property
    def steps(self) -> int:
        """Number of evaluated steps."""
        return self.states.shape[1] - self.first

    def futures(self, index: slice) -> SceneTracks:
        """Select some futures."""
        types = self.types
        return replace(
            self,
            states=self.states[index],
            length=self.length[index] if self.length.ndim == 2 else self.length,
            width=self.width[index] if self.width.ndim == 2 else self.width,
            present=None if self.present is None else self.present[index],
            types=types[index] if isinstance(types, np.ndarray) and types.ndim == 2 else types,
            acceleration=None if self.acceleration is None else self.acceleration[index],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedPaths:
    """Planned path of every vehicle at every evaluated step: from its position on through the current plan.

    A recording has one plan: its whole track.
    """

    x: FloatArray  # (C, R, V, H) centre, m; NaN without a plan. Straight lines bridge gaps.
    y: FloatArray
    index: IntArray  # (T,) number of the current plan
    column: IntArray  # (T,) first column of that plan that is still ahead; H if none is
    driven: bool = False  # the plan is the track itself, one column per step

    @classmethod
    def from_replans(cls, x: FloatArray, y: FloatArray, made_at: IntArray, steps: int) -> PlannedPaths:
        """Build from the plans of a run; the newest plan is the current one.

        Args:
            x: (C, R, V, H) m; column 0 is the step after the plan was made. ``y`` too.
            made_at: (R,) step of each plan, ascending; 0 is the seed scene.
            steps: number of evaluated steps.
        """
        step = np.arange(1, steps + 1)
        index = np.searchsorted(made_at, step, side="right") - 1
        column = np.minimum(step - np.asarray(made_at)[index], x.shape[3])
        return cls(x=x, y=y, index=index.astype(np.int64), column=column.astype(np.int64))

    @classmethod
    def from_tracks(cls, tracks: SceneTracks) -> PlannedPaths:
        """Build from recordings: the planned path is the track from each step on."""
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

    def futures(self, index: slice) -> PlannedPaths:
        """Select some futures."""
        return replace(self, x=self.x[index], y=self.y[index])
