"""Distances between two sets of samples, infinite ones included. Arrays in, numbers out."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scex_sumo.arrays import FloatArray
from scex_sumo.errors import InputError
from scex_sumo.statistics.density import BANDWIDTH, checked, common_grid, density


def kolmogorov_smirnov(first: ArrayLike, second: ArrayLike) -> float:
    """Largest difference between the empirical distributions of two sample sets, 0 to 1."""
    one, two = _two(first, second, "kolmogorov_smirnov")
    _, share_1, share_2 = _empirical(one, two)
    return float(np.abs(share_1 - share_2).max())


def wasserstein(first: ArrayLike, second: ArrayLike) -> float:
    """Wasserstein-1 distance of two sample sets in their unit: the area between their distributions.

    Returns:
        inf where the sets do not have the same share of samples at (either) infinity.
    """
    one, two = _two(first, second, "wasserstein")
    at, share_1, share_2 = _empirical(one, two)
    difference = np.abs(share_1 - share_2)[:-1]
    width = np.diff(at)
    # No difference over an infinite width is no distance.
    return float(np.sum(np.multiply(difference, width, where=difference > 0, out=np.zeros_like(difference))))


def jensen_shannon(first: ArrayLike, second: ArrayLike, bandwidth: float = BANDWIDTH) -> float:
    """Jensen-Shannon divergence, base 2, of the kernel densities of two sample sets on a common grid.

    Returns:
        0 (equal) to 1 (nothing in common); infinite samples form a class of their own.
    """
    one, two = _two(first, second, "jensen_shannon")
    finite = np.concatenate([one, two])
    grid = common_grid(finite[np.isfinite(finite)], bandwidth)
    masses = []
    for values in (one, two):
        mass = density(values, bandwidth, x=grid).pdf
        inner = np.count_nonzero(np.isfinite(values)) / values.size
        mass *= inner / mass.sum() if inner else 0.0
        ends = [np.count_nonzero(values == end) / values.size for end in (-np.inf, np.inf)]
        masses.append(np.concatenate([mass, ends]))
    middle = (masses[0] + masses[1]) / 2
    total = 0.0
    for mass in masses:
        some = mass > 0
        total += float(np.sum(mass[some] * np.log2(mass[some] / middle[some]))) / 2
    return min(max(total, 0.0), 1.0)


def _two(first: ArrayLike, second: ArrayLike, what: str) -> tuple[FloatArray, FloatArray]:
    one, two = checked(first, what), checked(second, what)
    if one.size == 0 or two.size == 0:
        raise InputError(f"{what}: {one.size} and {two.size} samples; both sets need at least one")
    return one, two


def _empirical(one: FloatArray, two: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """All values ascending, and both sets' shares at or below each."""
    at = np.unique(np.concatenate([one, two]))
    share_1 = np.searchsorted(np.sort(one), at, side="right") / one.size
    share_2 = np.searchsorted(np.sort(two), at, side="right") / two.size
    return at, share_1, share_2
