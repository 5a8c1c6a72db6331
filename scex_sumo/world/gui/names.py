"""Ids of vehicles in sumo-gui: how large they are, and which of them overprint no other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scex_sumo.arrays import FloatArray

LETTER_M = 2.0  # leaves the ends of a car free
_WIDE_M = 2.6  # of an id with its ground, to fit into a lane
_WIDTH, _HEIGHT = 0.52, 1.1  # of sumo-gui's letters with their ground, in heights of a letter


def letter_height(names: Sequence[str]) -> float:
    """Height of letters with which the longest of some ids fits into a lane, m."""
    longest = max((len(name) for name in names), default=1)
    return min(LETTER_M, _WIDE_M / (_WIDTH * longest))


def readable(names: Sequence[str], x: FloatArray, y: FloatArray, letter_m: float) -> list[int]:
    """Which ids can be written in the middle of their vehicles, each taking the room of those after it.

    Args:
        names: of N vehicles.
        x: (N,) m.
        y: (N,) m.
        letter_m: height of a letter.
    """
    half = np.array([_WIDTH * len(name) for name in names]) * letter_m / 2
    kept: list[int] = []
    for n in range(len(names)):
        over = (np.abs(x[kept] - x[n]) < half[kept] + half[n]) & (np.abs(y[kept] - y[n]) < _HEIGHT * letter_m)
        if not over.any():
            kept.append(n)
    return kept
