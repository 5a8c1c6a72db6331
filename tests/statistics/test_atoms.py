"""Values that many share are atoms; what cannot be negative has no density below 0."""

from __future__ import annotations

import numpy as np
import pytest

from scex_sumo.base.errors import InputError
from scex_sumo.statistics.density import mixed_density, split_atoms


def test_a_value_of_more_than_two_percent_is_an_atom() -> None:
    values = np.concatenate([np.zeros(30), [0.5, 0.5], np.linspace(1, 2, 68)])
    atoms, rest = split_atoms(values)
    assert [(a.value, a.share) for a in atoms] == [(0.0, 0.3)]  # two of 100 are not more than 2 %
    assert rest.size == 70


def test_of_few_samples_two_must_share_a_value() -> None:
    assert split_atoms([1.0, 2.0, 3.0])[0] == ()


def test_infinite_values_are_no_atom() -> None:
    atoms, rest = split_atoms([np.inf] * 5 + [1.0] * 5)
    assert [a.value for a in atoms] == [1.0] and np.isinf(rest).all()


def test_negative_zero_is_zero() -> None:
    assert [a.share for a in split_atoms([0.0, -0.0, 1.0])[0]] == pytest.approx([2 / 3])


def test_atoms_and_the_density_of_the_rest_make_one() -> None:
    rng = np.random.default_rng(0)
    values = np.concatenate([np.zeros(200), rng.exponential(0.2, 300)])
    found = mixed_density(values)
    x, pdf = found.x, found.pdf
    assert x[0] == 0.0
    assert float(np.sum((pdf[1:] + pdf[:-1]) / 2 * np.diff(x))) == pytest.approx(0.6, abs=1e-3)
    assert found.cdf[0] == pytest.approx(0.4)
    assert found.cdf[-1] == pytest.approx(1.0)
    assert np.all(np.diff(found.cdf) >= -1e-12)


def test_without_reflection_mass_lies_below_zero() -> None:
    found = mixed_density([0.05, 0.07, 0.09], reflect=False)
    assert found.x[0] < 0 < found.pdf[0] + found.pdf.max()
    assert mixed_density([-1.0, 1.0]).x[0] < -1


def test_the_band_is_as_wide_as_asked_for() -> None:
    found = mixed_density(np.linspace(1, 2, 50), half_width=0.1)
    low, high = found.band
    middle = (found.cdf > 0.1) & (found.cdf < 0.9)
    assert (high - low)[middle] == pytest.approx(0.2)


def test_all_samples_alike_are_one_atom_and_no_density() -> None:
    found = mixed_density([3.0, 3.0, 3.0])
    assert [a.share for a in found.atoms] == [1.0] and found.pdf.max() == 0


@pytest.mark.parametrize("least", [0.0, 1.0])
def test_a_least_share_is_between_0_and_1(least: float) -> None:
    with pytest.raises(InputError, match="least share"):
        split_atoms([1.0], least)


def test_no_samples_have_no_density() -> None:
    with pytest.raises(InputError, match="no samples"):
        mixed_density([])
