"""Entries of ordered pairs at their steps, and how those of equal tracks are dealt out to their children."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Placed:
    """Arrays of one length, of ordered pairs at their steps.

    Attributes:
        where: (N,) flat indices into (2P, C, T), ascending.
    """

    where: IntArray


E = TypeVar("E", bound=Placed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Entries(Placed):
    """Nanoscopic values of ordered pairs where they are defined.

    Attributes:
        value: (N,) in the metric's unit; inf is a value.
    """

    value: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Following(Placed):
    """All F car-following pairs (follower, leader) of a batch of scenes.

    Attributes:
        gap: (F,) distance from follower to leader, m.
        follower_speed: (F,) m/s.
        leader_speed: (F,) m/s.
        leader_acceleration: (F,) m/s².
    """

    gap: FloatArray
    follower_speed: FloatArray
    leader_speed: FloatArray
    leader_acceleration: FloatArray


def dealt(entries: E, bounds: IntArray, row: IntArray, steps: int) -> E:
    """Entries of pairs of tracks, for all children in which vehicles have them, ascending.

    Args:
        entries: of N pairs of tracks in one child, ``where`` ascending in (2N, 1, T).
        bounds: (2N + 1,) where the entries of each ordered pair begin.
        row: (P, C) number of each pair of vehicles among the pairs of tracks.
        steps: T.
    """
    ordered = np.concatenate([row, row + len(bounds) // 2]).reshape(-1)
    begin = bounds[ordered]
    count = bounds[ordered + 1] - begin
    some = np.flatnonzero(count)
    begin, count = begin[some], count[some]
    entry = np.arange(count.sum()) + np.repeat(begin - np.cumsum(count) + count, count)
    arrays = {field.name: getattr(entries, field.name)[entry] for field in fields(entries)}
    arrays["where"] = np.repeat(some * steps, count) + arrays["where"] % max(steps, 1)
    return replace(entries, **arrays)


class Known:
    """Values by index, each computed when it is asked for first.

    Args:
        size: number of values.
    """

    def __init__(self, size: int) -> None:
        self._values, self._known = np.empty(size), np.zeros(size, dtype=bool)

    def at(self, index: IntArray, values: Callable[[IntArray], FloatArray]) -> FloatArray:
        """(N,) values, those that are not known yet from ``values`` of their (K,) ascending indices."""
        new = np.zeros_like(self._known)
        new[index] = True
        missing = np.flatnonzero(new & ~self._known)
        self._values[missing] = values(missing)
        self._known[missing] = True
        found: FloatArray = self._values[index]
        return found
