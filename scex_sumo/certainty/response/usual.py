"""Usual P: the place of an encounter among the encounters of its reference class in a data set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Usual:
    """What is usual where an encounter takes place, and its place there.

    Attributes:
        median: P(collision), human-like, of the encounters of the class.
        rank: place of the encounter by P, 1 for the largest.
        of: number of encounters that have a place, this one included.
        what: the class, in words that follow "usual": "at this site", "in the whole data set".
    """

    median: float
    rank: int
    of: int
    what: str

    def words(self, probability: float) -> str:
        """Return the place of P in words: "30 × the median at this site, 2nd of 148"."""
        if not self.median:
            return f"the median {self.what} is 0, {ordinal(self.rank)} of {self.of}"
        times = f"{float(f'{probability / self.median:.1g}'):,.6g}".replace(",", " ")
        return f"{times} × the median {self.what}, {ordinal(self.rank)} of {self.of}"


def usual_in(others: FloatArray, probability: float, what: str) -> Usual:
    """Return what is usual among (n,) P of other encounters and one more with ``probability``."""
    every = np.append(others, probability)
    above = int(np.count_nonzero(others > probability))
    return Usual(median=float(np.median(every)), rank=1 + above, of=len(every), what=what)


def ordinal(number: int) -> str:
    """Return 1st, 2nd, 3rd, 4th, ..., 11th."""
    end = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{end}"
