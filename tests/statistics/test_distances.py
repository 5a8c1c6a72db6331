"""Distances between sets of samples: against scipy, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from scex_sumo.errors import InputError
from scex_sumo.statistics.distances import jensen_shannon, kolmogorov_smirnov, wasserstein

SAMPLES = np.random.default_rng(0).gamma(2.0, 3.0, 385)
INF = float("inf")

values = st.lists(st.floats(-1e3, 1e3, width=32), min_size=2, max_size=30)


@given(values, values)
def test_distances_agree_with_scipy(first: list[float], second: list[float]) -> None:
    ks = stats.ks_2samp(first, second, method="asymp").statistic
    assert kolmogorov_smirnov(first, second) == pytest.approx(ks, abs=1e-12)
    assert wasserstein(first, second) == pytest.approx(
        stats.wasserstein_distance(first, second), rel=1e-9, abs=1e-9
    )


def test_wasserstein_of_a_shift_is_the_shift() -> None:
    assert wasserstein(SAMPLES, SAMPLES + 0.7) == pytest.approx(0.7, rel=1e-9)


def test_wasserstein_with_mass_at_infinity() -> None:
    assert wasserstein([1.0, INF], [3.0, INF]) == pytest.approx(1.0)
    assert wasserstein([1.0, INF], [3.0, 3.0]) == INF
    assert kolmogorov_smirnov([1.0, INF], [1.0, 1.0]) == 0.5


def test_jensen_shannon_between_0_and_1() -> None:
    assert jensen_shannon(SAMPLES, SAMPLES) == pytest.approx(0.0, abs=1e-12)
    assert jensen_shannon([0.0], [100.0]) == pytest.approx(1.0, abs=1e-9)
    assert jensen_shannon([INF], [INF, INF]) == 0.0
    assert jensen_shannon([0.0, INF], [0.0, 100.0]) == pytest.approx(0.5, abs=1e-9)


def test_jensen_shannon_of_two_normals_by_quadrature() -> None:
    """Kernels of width 1 at 0 and 1: the integral over a fine grid of the closed densities."""
    x = np.linspace(-12, 13, 200_001)
    p, q = stats.norm.pdf(x), stats.norm.pdf(x - 1)
    middle = (p + q) / 2
    exact = np.sum(p * np.log2(p / middle) + q * np.log2(q / middle)) / 2 * (x[1] - x[0])
    # The common grid ends after 5 bandwidths.
    assert jensen_shannon([0.0], [1.0], bandwidth=1.0) == pytest.approx(exact, rel=1e-4)


def test_nothing_has_no_distance() -> None:
    with pytest.raises(InputError, match="0 and 1 samples"):
        kolmogorov_smirnov([], [1.0])
