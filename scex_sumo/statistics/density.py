"""Densities of metric values and their uncertainty.

Infinite samples count in every denominator: a density integrates to the share of finite samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BANDWIDTH: Final = 0.1
CONFIDENCE: Final = 0.95
WITHIN: Final = 1.959963984540054
"""Standard deviations of a normal distribution within which `CONFIDENCE` of it lies."""
MIN_SHARE: Final = 0.02
"""Share of the samples above which a value that they share exactly is an atom."""

_GRID_PER_BANDWIDTH = 4
_GRID_MARGIN = 5  # bandwidths around every sample that the default grid covers
_KERNEL_REACH = 9  # bandwidths after which the cumulated kernel is 1 in double precision


@dataclass(frozen=True, kw_only=True)
class Atom:
    """Value that many samples share exactly, and its share of all samples."""

    value: float
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Density:
    """Kernel density of samples and their cumulative distribution.

    Attributes:
        x: (G,) ascending, in the metric's unit.
        pdf: (G,) density, 1 / unit; it integrates to the share of samples outside ``atoms``.
        cdf: (G,) cumulative distribution with the same kernel, and a step at each atom.
        band: (G,) lower and (G,) upper limit of ``cdf``.
    """

    x: FloatArray
    pdf: FloatArray
    cdf: FloatArray
    band: tuple[FloatArray, FloatArray]
    atoms: tuple[Atom, ...] = ()

    def plot(self, ax: Axes | None = None, *, curve: str = "density", color: str = "#0072b2") -> Axes:
        """Draw the density, or the cumulative density with its band, with matplotlib; return the axes.

        Args:
            ax: None draws in pyplot's current axes.
            curve: ``density`` or ``cumulative``.
        """
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.gca()
        pdf = curve == "density"
        line, band = (self.pdf, (0.0 * self.pdf, self.pdf)) if pdf else (self.cdf, self.band)
        ax.fill_between(self.x, *band, color=color, alpha=0.18, linewidth=0)
        ax.plot(self.x, line, color=color, linewidth=1.2)
        ax.set_ylim(0.0, None if pdf else 1.0)
        return ax


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Estimate (NaN without samples), limits of its confidence interval, number of samples."""

    value: float
    low: float
    high: float
    count: int

    @property
    def percent(self) -> str:
        """In words, e.g. ``12 % [9–16]``, with the digits of `range`."""
        return self.share if self.low == self.high else f"{self.share} [{self.range}]"

    @property
    def share(self) -> str:
        """Its value in percent, with the digits of `range`."""
        return f"{100 * self.value:.{self._digits}f} %"

    @property
    def range(self) -> str:
        """Its limits in percent, e.g. ``9–16``; one decimal below 10 % and if they are within 2 %."""
        return f"{100 * self.low:.{self._digits}f}–{100 * self.high:.{self._digits}f}"

    @property
    def _digits(self) -> int:
        return 1 if self.high - self.low < 0.02 or self.high < 0.1 else 0


def density(
    samples: ArrayLike,
    bandwidth: float = BANDWIDTH,
    *,
    x: ArrayLike | None = None,
    reflect: bool = False,
    atoms: bool = False,
    half_width: float | None = None,
) -> Density:
    """Return the Gaussian kernel density with an absolute bandwidth.

    f(x) = sum of phi((x - x_i) / h) / (n h), F(x) = mean of Phi((x - x_i) / h). The default band is F +- the
    Dvoretzky-Kiefer-Wolfowitz half-width of independent draws, which holds for the smoothed truth, too.

    Args:
        samples: (n,) values; inf allowed.
        bandwidth: h, in the unit of the samples.
        x: where to evaluate, ascending; by default a grid of h / 4 around the samples.
        reflect: fold the density below 0 back.
        atoms: leave values that many samples share out of the density, see `split_atoms`.
        half_width: of the band.
    """
    values = checked(samples, "density")
    if not (np.isfinite(bandwidth) and bandwidth > 0):
        raise InputError(f"density: bandwidth {bandwidth}; choose one above 0, in the metric's unit")
    if values.size == 0:
        raise InputError("density: no samples; the metric is defined in no future")
    if reflect and values.min() < 0:
        raise InputError(f"density: reflection at 0 of a negative sample, {values.min()}; turn it off")
    shared, rest = split_atoms(values) if atoms else ((), values)
    grid = np.asarray(x, dtype=np.float64)
    if x is None:
        grid = common_grid(values[np.isfinite(values)], bandwidth)
        grid = np.union1d(grid, [atom.value for atom in shared])
        grid = grid[grid >= 0] if reflect else grid
    finite, count = rest[np.isfinite(rest)], max(rest.size, 1)
    pdf, below = _kernel_sums(finite, grid, bandwidth)
    below += np.count_nonzero(rest == -np.inf)
    if reflect:
        mirrored_pdf, mirrored_below = _kernel_sums(-finite, grid, bandwidth)
        pdf = np.where(grid >= 0, pdf + mirrored_pdf, 0.0)
        below = np.where(grid >= 0, below + mirrored_below - finite.size, 0.0)
    weight = rest.size / values.size
    pdf, cdf = weight * (pdf / (count * bandwidth)), weight * (below / count)
    for atom in shared:
        cdf = cdf + np.where(grid >= atom.value, atom.share, 0.0)
    width = dkw_half_width(values.size) if half_width is None else half_width
    band = np.maximum(cdf - width, 0.0), np.minimum(cdf + width, 1.0)
    return Density(x=grid, pdf=pdf, cdf=np.minimum(cdf, 1.0), band=band, atoms=shared)


def dkw_half_width(count: int) -> float:
    """Return the half-width of the 95 % band around a distribution of ``count`` independent samples.

    Source: Dvoretzky, Kiefer, Wolfowitz 1956, with the constant of Massart 1990.
    """
    return float(np.sqrt(np.log(2 / (1 - CONFIDENCE)) / (2 * count)))


def wilson_of(share: float, number: float) -> tuple[float, float]:
    """Return Wilson's interval of a share of ``number`` trials, whole or not; inf gives the share alone."""
    if not np.isfinite(number):
        return share, share
    z2 = WITHIN**2
    centre = (share * number + z2 / 2) / (number + z2)
    half = np.sqrt(z2 * (share * (1 - share) * number + z2 / 4)) / (number + z2)
    low = 0.0 if share == 0 else max(float(centre - half), 0.0)
    high = 1.0 if share == 1 else min(float(centre + half), 1.0)
    return low, high


def checked(samples: ArrayLike, what: str) -> FloatArray:
    """Return samples as (N,); raise an `InputError` that begins with ``what`` if some are NaN."""
    values = np.asarray(samples, dtype=np.float64).reshape(-1)
    missing = int(np.count_nonzero(np.isnan(values)))
    if missing:
        raise InputError(f"{what}: {missing} of {values.size} samples are NaN (undefined); drop them first")
    return values


def common_grid(finite: FloatArray, bandwidth: float) -> FloatArray:
    """Return (G,) multiples of h / 4 within 5 h of any sample, without the space between distant clusters."""
    step = bandwidth / _GRID_PER_BANDWIDTH
    reach = _GRID_MARGIN * _GRID_PER_BANDWIDTH
    largest = np.finfo(np.float64).max / 4 * min(step, 1.0)  # larger ones overflow
    centre = np.unique(np.rint(np.clip(finite, -largest, largest) / step))
    if centre.size == 0:
        return np.empty(0)
    apart = np.flatnonzero(np.diff(centre) > 2 * reach) + 1
    starts = centre[np.concatenate([[0], apart])] - reach
    ends = centre[np.concatenate([apart - 1, [centre.size - 1]])] + reach
    return np.concatenate([np.arange(a, b + 1) for a, b in zip(starts, ends, strict=True)]) * step


def _kernel_sums(finite: FloatArray, grid: FloatArray, bandwidth: float) -> tuple[FloatArray, FloatArray]:
    reach = _KERNEL_REACH * bandwidth
    start = np.searchsorted(grid, finite - reach)
    stop = np.searchsorted(grid, finite + reach)
    sample, column = _ranges(start, stop)
    z = (grid[column] - finite[sample]) / bandwidth
    heights = np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
    pdf = np.asarray(np.bincount(column, heights, minlength=grid.size), dtype=np.float64)
    below = np.asarray(np.bincount(column, _normal_cdf(z), minlength=grid.size), dtype=np.float64)
    # Samples behind the grid count fully.
    passed = np.bincount(stop, minlength=grid.size + 1)[: grid.size]
    below += np.cumsum(passed)
    return pdf, below


def _normal_cdf(z: FloatArray) -> FloatArray:
    """Return the standard normal distribution; the import of ``scipy.special`` would take longer."""
    return np.asarray(np.frompyfunc(math.erfc, 1, 1)(-z / math.sqrt(2)), dtype=np.float64) / 2


def _ranges(start: IntArray, stop: IntArray) -> tuple[IntArray, IntArray]:
    length = stop - start
    index = np.repeat(np.arange(length.size), length)
    offset = np.repeat(np.cumsum(length) - length, length)
    return index, np.arange(index.size) - offset + np.repeat(start, length)


def split_atoms(samples: ArrayLike) -> tuple[tuple[Atom, ...], FloatArray]:
    """Split samples (n,) into atoms and the other samples, infinite ones included.

    An atom is a finite value of more than `MIN_SHARE` of the samples, and of at least two.
    """
    values = checked(samples, "atoms")
    distinct, counts = np.unique(values + 0.0, return_counts=True)  # -0.0 becomes 0.0
    many = (counts > max(MIN_SHARE * values.size, 1)) & np.isfinite(distinct)
    frequent = zip(distinct[many].tolist(), (counts[many] / values.size).tolist(), strict=True)
    return tuple(Atom(value=v, share=s) for v, s in frequent), values[~np.isin(values, distinct[many])]
