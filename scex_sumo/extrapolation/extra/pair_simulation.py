"""Simulation of pairs of vehicles among others that repeat plain futures: cheaper than whole futures."""

from __future__ import annotations

from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.extrapolation.assignments import child_generator
from scex_sumo.extrapolation.job import VEHICLES_AT_ONCE, Job
from scex_sumo.extrapolation.rollout import Batch, roll_out
from scex_sumo.geometry.rectangles import Rectangles, separation
from scex_sumo.scene import States
from scex_sumo.world.plain import PlainWorld

PAIRS_AT_ONCE: Final = 4 * VEHICLES_AT_ONCE
"""Vehicles of all pairs that are simulated at once: two of each scene plan."""

_NOBODY = -1  # model of vehicles that repeat a plain future


class _AmongOthers(PlainWorld):
    """World in which some vehicles (C, V) are moved and the others have given states (C, T, V)."""

    def __init__(self, others: States, moved: BoolArray) -> None:
        super().__init__(*moved.shape)
        self._others, self._moved, self._now = others, moved, 0

    def move(self, states: States, mask: BoolArray) -> None:
        """Set the next states (C, V)."""
        both = [states, self._others[:, self._now]]
        states = States.joined(both, lambda parts: np.where(self._moved, *parts))
        self._now += 1
        super().move(states, np.ones_like(mask))


def simulated_gaps(job: Job, others: States, vehicles: IntArray, draw: FloatArray) -> FloatArray:
    """Return the least gaps (n,) of pairs (n, 2) whose drivers have numbers (n, 2), m.

    Each pair drives in one of the plain futures, which its first number selects. Gaps of boxes that overlap
    are negative.

    Args:
        others: (C, T, V) states of all vehicles in plain futures.
    """
    count, scene = len(draw), job.scene
    row, at = np.arange(count), np.floor(draw[:, 0] * others.x.shape[0]).astype(np.int64)
    assignment = np.full((count, scene.vehicles), _NOBODY)
    assignment[row[:, None], vehicles] = job.assignment[0][vehicles]
    numbers = np.full(assignment.shape, 0.5)
    numbers[row[:, None], vehicles] = draw
    batch = Batch(
        children=row,
        assignment=assignment,
        models=job.models.built,
        names=job.models.names,
        overridden=np.ones(len(job.models.built), dtype=np.bool_),
        route_draw=numbers,
        generators=[child_generator(job.settings.seed, 0)] * count,
    )
    world = _AmongOthers(others[at], assignment != _NOBODY)
    steps, replan = job.settings.steps, job.settings.replan
    states = roll_out(world, job.road, scene, batch, steps=steps, replan=replan).states
    outlines = [
        Rectangles.of(states[row, :, vehicle], scene.length[vehicle, None], scene.width[vehicle, None])
        for vehicle in vehicles.T
    ]
    return np.asarray(separation(*outlines).min(axis=1))
