"""Atoms: values that many children share exactly, separate from the density of the rest."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import InputError
from scex_sumo.statistics.density import (
    BANDWIDTH,
    Atom,
    Density,
    checked,
    common_grid,
    density,
    dkw_half_width,
)

MIN_SHARE: Final = 0.02


def split_atoms(samples: ArrayLike, least: float = MIN_SHARE) -> tuple[tuple[Atom, ...], FloatArray]:
    """Split samples (n,) into atoms and the other samples, infinite ones included.

    Args:
        least: an atom is a finite value of more than this share of the samples, and of at least two.
    """
    values = checked(samples, "atoms")
    if not 0 < least < 1:
        raise InputError(f"atoms: least share {least}; choose one between 0 and 1, e.g. {MIN_SHARE}")
    at, counts = np.unique(values + 0.0, return_counts=True)  # -0.0 becomes 0.0
    many = (counts > np.maximum(least * values.size, 1)) & np.isfinite(at)
    each = zip(at[many].tolist(), (counts[many] / values.size).tolist(), strict=True)
    return tuple(Atom(value=v, share=s) for v, s in each), values[~np.isin(values, at[many])]


def mixed_density(
    samples: ArrayLike,
    bandwidth: float = BANDWIDTH,
    *,
    reflect: bool | None = None,
    half_width: float | None = None,
    least: float = MIN_SHARE,
) -> Density:
    """Return atoms and the kernel density of the rest; arguments as of `density`.

    Args:
        reflect: fold the density below 0 back; by default if no sample is negative.
        least: share above which a value is an atom.
    """
    values = checked(samples, "density")
    if values.size == 0:
        raise InputError("density: no samples; the metric is defined in no future")
    atoms, rest = split_atoms(values, least)
    folded = bool(values.min() >= 0) if reflect is None else reflect
    finite = values[np.isfinite(values)]
    grid = np.union1d(common_grid(finite, bandwidth), [atom.value for atom in atoms])
    grid = grid[grid >= 0] if folded else grid
    pdf, cdf = np.zeros(grid.size), np.zeros(grid.size)
    if rest.size:
        smooth, weight = density(rest, bandwidth, x=grid, reflect=folded), rest.size / values.size
        pdf, cdf = weight * smooth.pdf, weight * smooth.cdf
    for atom in atoms:
        cdf = cdf + np.where(grid >= atom.value, atom.share, 0.0)
    half = dkw_half_width(values.size) if half_width is None else half_width
    band = np.maximum(cdf - half, 0.0), np.minimum(cdf + half, 1.0)
    return Density(x=grid, pdf=pdf, cdf=np.minimum(cdf, 1.0), band=band, atoms=atoms)
