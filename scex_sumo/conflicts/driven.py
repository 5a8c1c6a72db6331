"""Driven paths of vehicles in futures: driven, then as planned, then straight on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.geometry.paths import Paths
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.scene import States

HORIZON_S: Final = 8.0
"""Time for which a vehicle goes on from each step."""
NODES: Final = 64
"""Samples of a path, equally far from each other."""

_MOVED_M = 0.01  # a shorter step has no direction


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenPaths(Paths):
    """Paths of R vehicles of futures, driven in T steps, with `NODES` samples.

    Attributes:
        states: (R, T) as driven.
        length: (R,) m; so ``width``.
        arc: (R, T) arc length at each step, m.
    """

    states: States
    length: FloatArray
    width: FloatArray
    arc: FloatArray

    @classmethod
    def of(
        cls, states: States, length: FloatArray, width: FloatArray, planned: FloatArray | None
    ) -> DrivenPaths:
        """Build the paths of vehicles.

        Args:
            states: (R, T) as driven.
            planned: (2, R, H) x and y of the centres after the last step, m; None: straight on.
        """
        x, y, heading = _lines(states, planned)
        step = np.hypot(np.diff(x), np.diff(y))
        line = np.concatenate([np.zeros((len(x), 1)), step.cumsum(axis=1)], axis=1)
        arc = line[:, : states.shape[1]]
        reach = np.maximum((arc + HORIZON_S * states.speed).max(axis=1), 1.0)
        line[:, -1] = np.maximum(line[:, -1], line[:, -2] + 1e-3)  # the straight end
        spacing = reach / (NODES - 1)
        at = spacing[:, None] * np.arange(NODES)
        # A row at a time: its values are the same in any batch. Standing vehicles have equal arc lengths, of
        # which np.interp takes the last one.
        x, y, heading = (
            np.array([np.interp(*row) for row in zip(at, line, v, strict=True)]).reshape(at.shape)
            for v in (x, y, heading)
        )
        size = {"length": length, "width": width}
        return cls(states=states, arc=arc, spacing=spacing, x=x, y=y, heading=heading, **size)

    @cached_property
    def box(self) -> FloatArray:
        """(4, R) least x, least y, largest x, largest y of the outlines along the path, m."""
        reach = np.hypot(self.length, self.width) / 2
        low = [self.x.min(axis=1) - reach, self.y.min(axis=1) - reach]
        return np.stack([*low, self.x.max(axis=1) + reach, self.y.max(axis=1) + reach])

    def outlines(self, row: IntArray, node: IntArray) -> Rectangles:
        """Return outlines of vehicles at samples of their paths."""
        return Rectangles(
            x=self.x[row, node],
            y=self.y[row, node],
            heading=self.heading[row, node],
            half_length=self.length[row] / 2,
            half_width=self.width[row] / 2,
        )


def _lines(states: States, planned: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x, y and heading (R, T + H + 1) of the points of each way; the last point is far ahead."""
    x, y = states.x, states.y
    if planned is not None:
        x, y = np.concatenate([x, planned[0]], axis=1), np.concatenate([y, planned[1]], axis=1)
    dx, dy = np.diff(x[:, states.shape[1] - 1 :]), np.diff(y[:, states.shape[1] - 1 :])
    turn = np.where(np.hypot(dx, dy) > _MOVED_M, np.arctan2(dy, dx), np.nan)
    heading = np.concatenate([states.heading, turn], axis=1)
    for column in range(1, heading.shape[1]):  # a short step keeps the heading
        heading[:, column] = np.where(
            np.isnan(heading[:, column]), heading[:, column - 1], heading[:, column]
        )
    heading = np.unwrap(heading, axis=1)
    far = HORIZON_S * np.maximum(states.speed.max(axis=1), 1.0)
    x = np.concatenate([x, (x[:, -1] + far * np.cos(heading[:, -1]))[:, None]], axis=1)
    y = np.concatenate([y, (y[:, -1] + far * np.sin(heading[:, -1]))[:, None]], axis=1)
    return x, y, np.concatenate([heading, heading[:, -1:]], axis=1)
