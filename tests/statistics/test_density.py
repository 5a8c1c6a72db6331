"""Densities and intervals: against their formulas, scipy, and what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from scex_sumo.base.errors import InputError
from scex_sumo.statistics.density import density, dkw_half_width
from tests.statistics.shares import wilson

SAMPLES = np.random.default_rng(0).gamma(2.0, 3.0, 385)
values = st.lists(st.floats(-1e3, 1e3, width=32), min_size=2, max_size=30)


@given(values, st.sampled_from([0.05, 0.1, 2.0]))
def test_the_default_grid_holds_the_whole_density(samples: list[float], bandwidth: float) -> None:
    """Beyond 5 bandwidths a kernel has 6e-7 left; the trapezoid rule adds less."""
    curve = density(samples, bandwidth)
    assert np.all(np.diff(curve.x) > 0)
    step = bandwidth / 4
    assert np.sum(curve.pdf) * step == pytest.approx(1.0, abs=1e-6)
    assert np.all(np.diff(curve.cdf) >= -1e-15)
    assert curve.cdf[0] < 1e-6 and curve.cdf[-1] > 1 - 1e-6


def test_the_band_is_0_069_wide_for_385_futures() -> None:
    assert dkw_half_width(385) == pytest.approx(np.sqrt(np.log(40) / 770), rel=1e-12)
    assert round(dkw_half_width(385), 3) == 0.069
    curve = density(SAMPLES)
    low, high = curve.band
    np.testing.assert_allclose(low, np.maximum(curve.cdf - dkw_half_width(385), 0), rtol=1e-12)
    np.testing.assert_allclose(high, np.minimum(curve.cdf + dkw_half_width(385), 1), rtol=1e-12)


def test_the_band_covers_the_smoothed_truth_19_times_in_20() -> None:
    """The standard normal smoothed by h is normal with variance 1 + h²; DKW is conservative."""
    rng = np.random.default_rng(1)
    x = np.linspace(-4, 4, 200)
    truth = stats.norm.cdf(x / np.sqrt(1.01))
    inside = 0
    for _ in range(300):
        low, high = density(rng.normal(size=50), x=x).band
        inside += bool(np.all((low <= truth) & (truth <= high)))
    # 300 draws: a true coverage of 0.95 stays above 0.91 in all but 1 of 1000 cases.
    assert inside / 300 > 0.91


@pytest.mark.parametrize(("successes", "count"), [(0, 385), (1, 10), (16, 385), (200, 385), (385, 385)])
def test_wilson_agrees_with_scipy(successes: int, count: int) -> None:
    ours = wilson(successes, count)
    theirs = stats.binomtest(successes, count).proportion_ci(method="wilson")
    assert (ours.value, ours.low, ours.high) == pytest.approx(
        (successes / count, theirs.low, theirs.high), abs=1e-12
    )


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: density([]), "no samples"),
        (lambda: density([1.0, np.nan]), "1 of 2 samples are NaN"),
        (lambda: density([1.0], 0.0), "bandwidth 0.0"),
    ],
)
def test_what_makes_no_sense_is_refused(call: object, message: str) -> None:
    assert callable(call)
    with pytest.raises(InputError, match=message):
        call()
