"""A suite's number: rates per hour of recorded traffic, estimated from weighted cases, with intervals.

Horvitz-Thompson estimator: the sum of weight · y over the cases, over the recorded hours. Its variance is
Hájek's (1964) for draws of fixed size, within kinds, and that of the futures besides. The interval has
Student's t, whose degrees of freedom are those of Satterthwaite (1946): few if the variance comes from few
cases. It is on the log scale, but for differences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray

LEVEL: Final = 0.95
WIDE: Final = 30.0
"""Factor between both ends of an interval from which a larger suite is advised."""
NARROW: Final = 3.0
"""The factor that such a suite would have."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Estimated rate per hour, its 95 % interval, standard error and degrees of freedom."""

    value: float
    low: float
    high: float
    deviation: float
    freedom: float

    def cases_needed(self, cases: int) -> int | None:
        """Return the cases for an interval of a factor of 3, by a root law; None if this one is below 30."""
        if self.low <= 0 or self.high < WIDE * self.low:
            return None
        half = 2 * _student(math.inf) * self.deviation / self.value
        return math.ceil(cases * (half / math.log(NARROW)) ** 2)

    def words(self) -> str:
        """Return value and interval, two digits each."""
        return f"{_number(self.value)} [{_number(self.low)}, {_number(self.high)}]"


def _number(value: float) -> str:
    digits = float(f"{value:.2g}")
    return f"{digits:,.0f}".replace(",", "\u202f") if abs(digits) >= 100 else f"{digits:g}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """How n cases were drawn, (n,) each.

    Attributes:
        weight: encounters for which a case stands.
        chance: probability of being drawn.
        stratum: number of its kind.
        hours: recorded time.
    """

    weight: FloatArray
    chance: FloatArray
    stratum: IntArray
    hours: float

    def part(self, ran: BoolArray) -> Design:
        """Return the design of the cases (n,) that ran: those of the same kind stand for the others, too."""
        total = np.bincount(self.stratum, self.weight)
        total_ran = np.bincount(self.stratum, self.weight * ran)
        factor = (total / np.where(total_ran > 0, total_ran, 1.0))[self.stratum[ran]]
        return Design(
            weight=self.weight[ran] * factor,
            chance=self.chance[ran] / factor,
            stratum=self.stratum[ran],
            hours=self.hours,
        )

    def total(self, y: FloatArray, drawn: FloatArray) -> tuple[float, float, float]:
        """Return the estimated sum over the population, its variance, and the degrees of freedom.

        Args:
            y: (n,) of the cases; ``drawn`` (n,) its variance by the futures.
        """
        weighted = self.weight * y
        terms = [(float((self.weight**2 * drawn).sum()), math.inf)]
        for group in self._groups():
            left, n = 1 - self.chance[group], len(group)
            if n == 1:  # of one that stands for others nothing is known but its size
                terms.append((float(left[0] * weighted[group[0]] ** 2), 1.0))
            else:
                mean = (left * weighted[group]).sum() / left.sum()
                terms.append((float(n / (n - 1) * (left * (weighted[group] - mean) ** 2).sum()), n - 1.0))
        variance = sum(term for term, _ in terms)
        spread = sum(term**2 / freedom for term, freedom in terms)
        return float(weighted.sum()), variance, variance**2 / spread if spread > 0 else math.inf

    def _groups(self) -> list[IntArray]:
        """Return the cases not taken for sure, kind by kind; kinds with one such case are one group."""
        unsure = np.flatnonzero(self.chance < 1 - 1e-9)
        number = self.stratum[unsure]
        alone = np.bincount(number, minlength=1)[number] == 1
        number = np.where(alone, -1, number)
        return [unsure[number == h] for h in np.unique(number).tolist()]

    def rate(self, y: FloatArray, drawn: FloatArray) -> Rate:
        """Return the rate of events per hour, with an interval on the log scale."""
        value, variance, freedom = self.total(y, drawn)
        half = _student(freedom) * math.sqrt(variance) / max(value, 1e-300)
        factor = math.exp(min(half, 500.0))
        return self._rate(value, value / factor, value * factor, variance, freedom)

    def difference(self, y: FloatArray, drawn: FloatArray) -> Rate:
        """Return the rate of a paired difference ``y``, which may have either sign."""
        value, variance, freedom = self.total(y, drawn)
        half = _student(freedom) * math.sqrt(variance)
        return self._rate(value, value - half, value + half, variance, freedom)

    def _rate(self, value: float, low: float, high: float, variance: float, freedom: float) -> Rate:
        """Return a rate by sums; neither end is beyond a contact in every encounter, or as much less."""
        most = float(self.weight.sum())
        sums = value, max(low, -most), min(high, most), math.sqrt(variance)
        value, low, high, deviation = (number / self.hours for number in sums)
        return Rate(value=value, low=low, high=high, deviation=deviation, freedom=min(freedom, 1e9))


def _student(freedom: float) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(min(freedom, 1e9), (1 + LEVEL) / 2))
