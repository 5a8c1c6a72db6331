"""Normal distribution: scipy's numbers to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from scex_sumo.statistics.normal import normal_cdf, normal_quantile, normal_quantiles

Z = np.concatenate(
    [
        np.random.default_rng(0).normal(size=100_000) * 3,
        np.linspace(-45, 45, 100_001),
        [0.0, -0.0, np.inf, -np.inf, np.nan, np.sqrt(0.5), 1.0, -1.0],
    ]
)
SHARES = np.concatenate([np.random.default_rng(0).random(100_000), [0.0, 1.0, 1e-300, np.nan]])


def test_distribution_and_quantiles_are_scipys_to_the_bit() -> None:
    np.testing.assert_array_equal(normal_cdf(Z), special.ndtr(Z))
    np.testing.assert_array_equal(normal_quantiles(SHARES), special.ndtri(SHARES))


@pytest.mark.parametrize("share", [0.5, 0.9, 0.95, 0.975, 0.995])
def test_one_quantile_is_a_plain_number(share: float) -> None:
    assert normal_quantile(share) == special.ndtri(share)
