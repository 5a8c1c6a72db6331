"""Rules of a road at one moment: passages through junctions with their right of way, signals."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from scex_sumo.base.arrays import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """States of a signal group over time, which repeat."""

    letters: str = ""  # SUMO's, one for each phase, e.g. ``G``, ``y``, ``r``; empty if unknown
    ends_s: FloatArray = field(default_factory=lambda: np.empty(0))  # (K,) of each phase within the cycle
    start_s: float = 0.0  # place of the seed moment in the cycle

    def at(self, time_s: float) -> tuple[str, float]:
        """Return the state at a time since the seed moment, and for how many seconds it has been shown."""
        if not self.letters:
            return "", 0.0
        place = (self.start_s + time_s + 1e-6) % self.ends_s[-1]
        phase = int(np.searchsorted(self.ends_s, place, side="right")) % len(self.letters)
        since, k = place - (self.ends_s[phase - 1] if phase else 0.0), phase - 1
        while self.letters[k] == self.letters[phase] and k % len(self.letters) != phase:
            since += self.ends_s[k] - (self.ends_s[k - 1] if k % len(self.letters) else 0.0)
            k -= 1
        return self.letters[phase], float(since)


@dataclass(frozen=True, kw_only=True, eq=False)
class Passage:
    """Way through a junction from a lane to a lane, with its rules."""

    line: FloatArray  # (P, 2) centreline, m; without a drawn stop line vehicles stop at its beginning
    lanes: tuple[int, ...]  # under it, from the one before the junction to the one after
    state: str  # SUMO's of the link: ``M`` (priority), ``m`` (yield), ``s`` (stop), ``w`` (all-way stop), ...
    signal: int  # index of its signal group; -1 without a light
    yields_to: tuple[int, ...]  # indices of the passages to which it gives way


@dataclass(frozen=True, kw_only=True, eq=False)
class Rules:
    """Rules of a road at one moment, as its SUMO net has them."""

    passages: tuple[Passage, ...]
    signals: tuple[Signal, ...] = ()
    stop_lines: tuple[FloatArray, ...] = ()  # (S, 2) polylines, m; so the outlines of the crosswalks
    crosswalks: tuple[FloatArray, ...] = ()
    notes: tuple[str, ...] = ()  # what the net lacks
    net: str = ""  # SHA-256 of its file
