"""Trajectories of all children for a page: quantised, and each different one stored once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.reports.page.packing import quantized, second_differences
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, States

POSITION_M, HEADING_RAD = 0.01, 0.001


@dataclass(frozen=True, kw_only=True, eq=False)
class UniqueTracks:
    """What the vehicles did, without repetition.

    Attributes:
        start: (V, 3) x and y in cm, heading in mrad, at the moment of the seed scene.
        motion: (U, T, 3) second differences of the change since then, ordered by vehicle.
        which: (C, V) rows of ``motion``.
    """

    start: IntArray
    motion: IntArray
    which: IntArray


def unique_tracks(run: Run) -> UniqueTracks:
    """The trajectories of a run from the moment of its seed scene on."""
    vehicles = len(run.info["seed_scene"]["track_ids"])
    shape = (run.children, vehicles, LOGGED_HISTORY + int(run.info["steps"]))
    x, y, heading = (np.asarray(run.tracks[name]).reshape(shape) for name in ("x", "y", "psi_rad"))
    poses = _poses(x, y, heading)[:, :, LOGGED_HISTORY - 1 :]
    start = poses[0, :, 0]
    moved = np.ascontiguousarray((poses[:, :, 1:] - start[:, None]).astype(np.int32).swapaxes(0, 1))
    which = np.empty(shape[:2], dtype=np.int64)
    parts = []
    count = 0
    for vehicle, rows in enumerate(moved):
        keys = rows.reshape(len(rows), -1).view(np.dtype((np.void, rows[0].nbytes))).reshape(-1)
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        parts.append(rows[first])
        which[:, vehicle] = inverse.reshape(-1) + count
        count += len(first)
    return UniqueTracks(start=start, motion=second_differences(np.concatenate(parts)), which=which)


def whole_tracks(states: States, start: IntArray) -> IntArray:
    """Recorded (V, F) states as second differences (V, F, 3) of the change since the start."""
    return second_differences(_poses(states.x, states.y, states.heading) - start[:, None])


def _poses(x: FloatArray, y: FloatArray, heading: FloatArray) -> IntArray:
    return np.stack(
        [quantized(x, POSITION_M), quantized(y, POSITION_M), quantized(np.unwrap(heading), HEADING_RAD)], -1
    )
