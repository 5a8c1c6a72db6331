"""Distances of one metric's values: by hand, and against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.distance import jensenshannon

from scex_sumo.statistics.density import density
from scex_sumo.studies.compare.compare import (
    Scale,
    jensen_shannon_distances,
    pooled_scale,
    wasserstein_distances,
)
from scex_sumo.studies.sample_size.sample_size import errors

INF, NAN = float("inf"), float("nan")
ROUNDING = 1e-9  # sums of at most 80 terms of size 1e3 in other orders


def arrays(*columns: list[float]) -> list[np.ndarray]:
    return [np.array(c, dtype=float) for c in columns]


def scipys_jensen_shannon(one: np.ndarray, two: np.ndarray) -> float:
    """Root of the divergence of two kernel densities; a grid of both leaves 6e-7 of either outside."""
    x = density(np.concatenate([one, two])).x
    return float(jensenshannon(density(one, x=x).pdf, density(two, x=x).pdf, base=2))


def test_a_shift_by_the_middle_of_all_values_is_a_distance_of_one() -> None:
    # 0 to 10 twice, the second time moved by s. The pool's middle 80 % is as wide as the unit by definition.
    one = np.arange(11.0)
    scale = pooled_scale([one, one + 2])
    assert wasserstein_distances([one, one + 2], scale)[0, 1] == pytest.approx(2 / scale.unit, rel=1e-12)


def test_the_unit_is_the_width_of_the_middle_80_percent() -> None:
    scale = pooled_scale(arrays(list(range(1, 11)), list(range(1, 11))))
    # Smallest values with at least 10, 50 and 90 % of the weight: 1, 5 and 9 of 10.
    assert (scale.unit, scale.middle, scale.low, scale.high) == (8.0, 5.0, -7.0, 17.0)


def test_every_run_weighs_the_same_in_the_scale() -> None:
    # By runs 0 has half of the weight and 1 has 8/18: the 90 % quantile is 1. By values 98 of 107 are 0, over
    # 90 %, and the range of all would be the unit.
    many, few = np.zeros(98), np.array([1.0] * 8 + [100.0])
    assert pooled_scale([many, few]).unit == 1.0
    assert pooled_scale([np.concatenate([many, few])]).unit == 100.0


def test_within_the_fences_it_is_wasserstein_over_the_unit() -> None:
    rng = np.random.default_rng(3)
    columns = [rng.gamma(2.0, 3.0, 96), rng.gamma(3.0, 2.0, 60), rng.normal(5.0, 1.0, 7)]
    scale = Scale(unit=2.5, middle=4.0, low=-100.0, high=100.0)
    distances = wasserstein_distances(columns, scale)
    for i in range(3):
        for j in range(3):
            expected = stats.wasserstein_distance(columns[i], columns[j]) / 2.5
            assert distances[i, j] == pytest.approx(expected, abs=ROUNDING)


def test_outliers_move_a_distance_only_up_to_the_fence() -> None:
    # One of ten futures moves from 0 to beyond the fence at 20 m, unit 10 m: 2 units by a tenth.
    scale = Scale(unit=10.0, middle=0.0, low=-20.0, high=20.0)
    near, far, beyond = arrays([0.0] * 10, [0.0] * 9 + [1e9], [0.0] * 9 + [INF])
    distances = wasserstein_distances([near, far, beyond], scale)
    assert distances[0, 1] == pytest.approx(0.2, abs=1e-15)
    assert distances[0, 2] == distances[0, 1]
    assert distances[1, 2] == 0.0


def test_jensen_shannon_is_the_root_of_the_divergence_of_the_densities() -> None:
    rng = np.random.default_rng(5)
    one, two, three = rng.normal(0, 1, 50), rng.normal(1, 1, 80), rng.gamma(2, 1, 40)
    distances = jensen_shannon_distances([one, two, three])
    assert distances[0, 1] == pytest.approx(scipys_jensen_shannon(one, two), abs=1e-6)
    assert distances[0, 2] == pytest.approx(scipys_jensen_shannon(one, three), abs=1e-6)


def test_jensen_shannon_knows_undefined_and_infinite_as_classes() -> None:
    zero, undefined, infinite, half = arrays([0.0, 0.0], [NAN, NAN], [INF, INF], [0.0, NAN])
    distances = jensen_shannon_distances([zero, undefined, infinite, half])
    np.testing.assert_allclose(distances[:3, :3], 1 - np.eye(3), atol=1e-12)
    # Half of the mass in common: JSD = h(1/4) - 1/2 with the binary entropy h.
    divergence = -0.25 * np.log2(0.25) - 0.75 * np.log2(0.75) - 0.5
    assert distances[0, 3] == pytest.approx(np.sqrt(divergence), rel=1e-9)


def test_jensen_shannon_of_two_normals_by_quadrature() -> None:
    """Kernels of width 1 at 0 and 1: the integral over a fine grid of the closed densities."""
    x = np.linspace(-12, 13, 200_001)
    p, q = stats.norm.pdf(x), stats.norm.pdf(x - 1)
    middle = (p + q) / 2
    exact = np.sum(p * np.log2(p / middle) + q * np.log2(q / middle)) / 2 * (x[1] - x[0])
    # The common grid ends after 5 bandwidths.
    found = jensen_shannon_distances(arrays([0.0], [1.0]), bandwidth=1.0)[0, 1]
    assert found**2 == pytest.approx(exact, rel=1e-4)


places = st.lists(st.floats(-1e3, 1e3, width=32), min_size=2, max_size=30)


@given(places, st.lists(st.integers(0, 29), min_size=1, max_size=30))
def test_errors_of_a_draw_are_scipys_distances(values: list[float], drawn: list[int]) -> None:
    whole, draw = np.array(values), np.array(drawn) % len(values)
    found = errors(whole, [draw])
    ks = stats.ks_2samp(whole[draw], whole, method="asymp").statistic
    assert found.ks[0] == pytest.approx(ks, abs=1e-12)
    w1 = stats.wasserstein_distance(whole[draw], whole)
    assert found.w1[0] == pytest.approx(w1, rel=1e-9, abs=1e-9)


def test_errors_by_hand() -> None:
    found = errors(np.array([0.0, 1.0, 2.0, 3.0]), [np.array([0, 0]), np.array([3, 2, 1, 0])])
    assert found.ks.tolist() == [0.75, 0.0]
    assert found.w1.tolist() == [1.5, 0.0]
    assert found.jsd[1] == 0.0


def test_the_divergence_of_draws_is_scipys_of_the_densities() -> None:
    rng = np.random.default_rng(0)
    values = np.round(rng.gamma(2.0, 1.5, 300), 2)
    values[rng.random(300) < 0.2] = np.nan
    draws = [rng.permutation(300)[:40] for _ in range(6)]
    found = errors(values, draws)
    whole = values[~np.isnan(values)]
    for index, draw in enumerate(draws):
        some = values[draw][~np.isnan(values[draw])]
        # The kernel is cut at 8 bandwidths, where it is 1e-14 of its height.
        assert found.jsd[index] == pytest.approx(scipys_jensen_shannon(some, whole) ** 2, abs=1e-9)


def test_a_draw_without_a_defined_future_has_no_error() -> None:
    found = errors(np.array([np.nan, 1.0, 2.0]), [np.array([0, 0]), np.array([0, 1])])
    assert np.isnan([found.ks[0], found.w1[0], found.jsd[0]]).all()
    assert found.ks[1] == 0.5
    assert np.isnan(errors(np.full(3, np.nan), [np.array([1])]).ks).all()


def test_values_near_the_largest_number_have_finite_distances() -> None:
    columns = [np.array([-1.7e308, 1.7e308]), np.array([1.7e308, 1.7e308])]
    scale = pooled_scale(columns)
    assert wasserstein_distances(columns, scale)[0, 1] == pytest.approx(1.5)  # from fence to fence
    assert jensen_shannon_distances(columns)[0, 1] <= 1.0
