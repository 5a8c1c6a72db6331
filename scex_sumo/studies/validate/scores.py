"""Scores of forecasts against what happened: of probabilities and of samples."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray

_CENTRAL = 0.9  # share of the samples
_BINS = 10
_DRAWS = 400  # of groups


@dataclass(frozen=True, eq=False)
class Reliability:
    """Reliability diagram: mean forecast, share of events and number of forecasts (B,) by bins.

    The bins have equal widths; empty ones are left out.
    """

    forecast: FloatArray
    observed: FloatArray
    count: IntArray


def brier(forecast: FloatArray, happened: BoolArray) -> float:
    """Return the mean (p - o)² of probabilities (N,) and outcomes (N,). Source: Brier 1950."""
    return float(np.mean((forecast - happened) ** 2))


def skill(score: float, reference: float) -> float:
    """Return 1 - score / reference: 1 is perfect, 0 no better; NaN if the reference is perfect."""
    return 1.0 - score / reference if reference > 0 else float("nan")


def reliability(forecast: FloatArray, happened: BoolArray) -> Reliability:
    """Return the reliability diagram of forecasts (N,) and outcomes (N,)."""
    bin_of = np.minimum((np.asarray(forecast) * _BINS).astype(np.int64), _BINS - 1)
    count = np.bincount(bin_of)
    used = count > 0
    mean = [np.bincount(bin_of, weights=w)[used] / count[used] for w in (forecast, happened)]
    return Reliability(mean[0], mean[1], count[used].astype(np.int64))


def crps(samples: FloatArray, outcome: float) -> float:
    """Return the continuous ranked probability score E|X - y| - ½ E|X - X'| of samples (C,).

    Source: Gneiting and Raftery 2007, of the empirical distribution.
    """
    x, n = np.sort(samples), len(samples)
    spread = float((2 * np.arange(1, n + 1) - n - 1) @ x) / n**2
    return float(np.abs(x - outcome).mean()) - spread


def covered(samples: FloatArray, outcome: float) -> bool:
    """Return whether an outcome lies within the central 90 % of samples (C,), ends included.

    Quantiles are at plotting positions k / (C + 1). Source: Hyndman and Fan 1996, definition 6.
    """
    low, high = np.quantile(samples, [(1 - _CENTRAL) / 2, (1 + _CENTRAL) / 2], method="weibull")
    return bool(low <= outcome <= high)


def group_bootstrap(statistic: Callable[[IntArray], float], groups: IntArray) -> tuple[float, float]:
    """Return the 95 % interval of a statistic from whole groups drawn with replacement.

    Args:
        statistic: of the indices (n,) of some rows; NaN if undefined.
        groups: (N,) group of each row; one group has the interval NaN.

    Source: Davison and Hinkley 1997, section 3.8.
    """
    names = np.unique(groups)
    if len(names) < 2:
        return float("nan"), float("nan")
    members = [np.flatnonzero(groups == name) for name in names]
    rng = np.random.default_rng(0)
    values_drawn = [
        statistic(np.concatenate([members[k] for k in rng.integers(0, len(names), len(names))]))
        for _ in range(_DRAWS)
    ]
    known = [value for value in values_drawn if np.isfinite(value)]
    if not known:
        return float("nan"), float("nan")
    low, high = np.quantile(known, [0.025, 0.975])
    return float(low), float(high)
