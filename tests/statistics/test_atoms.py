"""Values that many share are atoms; what cannot be negative has no density below 0."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.statistics.density import density, split_atoms


def test_a_value_of_more_than_two_percent_is_an_atom() -> None:
    values = np.concatenate([np.zeros(30), [0.5, 0.5], np.linspace(1, 2, 68)])
    atoms, rest = split_atoms(values)
    assert [(a.value, a.share) for a in atoms] == [(0.0, 0.3)]  # two of 100 are not more than 2 %
    assert rest.size == 70


def test_atoms_and_the_density_of_the_rest_make_one() -> None:
    rng = np.random.default_rng(0)
    values = np.concatenate([np.zeros(200), rng.exponential(0.2, 300)])
    found = density(values, reflect=True, atoms=True)
    x, pdf = found.x, found.pdf
    assert x[0] == 0.0
    assert float(np.sum((pdf[1:] + pdf[:-1]) / 2 * np.diff(x))) == pytest.approx(0.6, abs=1e-3)
    assert found.cdf[0] == pytest.approx(0.4)
    assert found.cdf[-1] == pytest.approx(1.0)
    assert np.all(np.diff(found.cdf) >= -1e-12)
