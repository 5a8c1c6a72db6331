"""Drivers of an environment as a run draws them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from scex_sumo.base.arrays import IntArray
from scex_sumo.extrapolation.assignments import assignments


def as_in_a_run(fixed: int | None = None) -> Callable[..., IntArray]:
    """In place of independent draws: those of a run in which one vehicle, by index, has a given model."""

    def drawn(weights: Sequence[float], futures: IntArray, vehicles: int, *, seed: int) -> IntArray:
        always = {} if fixed is None else {fixed: 0}
        count = int(futures.max()) + 1
        return assignments(weights, range(vehicles), futures=count, seed=seed, fixed=always)[futures]

    return drawn
