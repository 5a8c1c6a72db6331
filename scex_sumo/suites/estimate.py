"""A suite's number: rates per hour of recorded traffic, estimated from weighted cases, with intervals.

Stratified estimator: the sum of weight · y over the cases, over the recorded hours. Its variance is that
within strata, as if their cases were drawn with replacement, times the share that was not drawn; it holds the
variance of the futures, too. The interval is on the log scale with Student's t, whose degrees of freedom are
those of Satterthwaite (1946): few if the variance comes from few strata.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray

LEVEL: Final = 0.95
_NONE_SEEN = 3.0  # rule of three


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Estimated rate per hour with its 95 % interval.

    Attributes:
        deviation: standard error.
        freedom: degrees of freedom.
    """

    value: float
    low: float
    high: float
    deviation: float
    freedom: float

    def to_json(self) -> Mapping[str, Any]:
        """Return the values by name."""
        return asdict(self)

    def less(self, known: float) -> Rate:
        """Return the difference to a rate that is known for the whole population."""
        return replace(self, value=self.value - known, low=self.low - known, high=self.high - known)

    def words(self) -> str:
        """Return value and interval, two digits each."""
        return f"{_number(self.value)} [{_number(self.low)}, {_number(self.high)}]"


def _number(value: float) -> str:
    digits = float(f"{value:.2g}")
    return f"{digits:,.0f}".replace(",", " ") if abs(digits) >= 100 else f"{digits:g}"


def total(
    y: FloatArray, weight: FloatArray, stratum: IntArray, sizes: IntArray, drawn: FloatArray | None = None
) -> tuple[float, float, float]:
    """Return the estimated sum over the population, its variance, and the degrees of freedom.

    Args:
        y: (n,) of the cases.
        weight: (n,) candidates for which a case stands; ``stratum`` (n,) too.
        sizes: (H,) candidates of the strata.
        drawn: (n,) variance of y by the futures of a case; counts in full where a stratum was taken whole.
    """
    each = weight * y
    variance, spread = 0.0, 0.0
    for h in range(len(sizes)):
        inside = stratum == h
        count = int(inside.sum())
        if count == 0:
            continue
        left = max(0.0, 1.0 - count / sizes[h])
        if count > 1:
            part = left * count * float(np.var(each[inside], ddof=1))
        else:  # of one that stands for others nothing is known but its size
            part = left * float((each[inside] ** 2).sum())
        variance += part
        spread += part**2 / max(count - 1, 1)
        if drawn is not None:  # many futures: their variance is known
            variance += (1.0 - left) * float((weight[inside] ** 2 * drawn[inside]).sum())
    freedom = variance**2 / spread if spread > 0 else float(len(y))
    return float(each.sum()), variance, max(freedom, 1.0)


def rate(
    y: FloatArray,
    weight: FloatArray,
    stratum: IntArray,
    sizes: IntArray,
    hours: float,
    *,
    most: FloatArray,
    drawn: FloatArray | None = None,
) -> Rate:
    """Return the rate of events per hour.

    Args:
        most: (n,) largest value that y can have in each case; bounds a rate of which nothing was seen.
    """
    value, variance, freedom = total(y, weight, stratum, sizes, drawn)
    deviation = math.sqrt(variance)
    if value <= 0:
        high = _NONE_SEEN / max(len(y), 1) * float((weight * most).sum())
        return Rate(value=0.0, low=0.0, high=high / hours, deviation=0.0, freedom=freedom)
    spread = math.exp(_student(freedom) * deviation / value)
    low, high = value / spread, value * spread
    return Rate(
        value=value / hours, low=low / hours, high=high / hours, deviation=deviation / hours, freedom=freedom
    )


def _student(freedom: float) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1 + LEVEL) / 2))
