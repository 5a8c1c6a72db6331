"""Curves of a page: densities and cumulative curves of a run's own tables, as small integers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from scex_sumo.arrays import FloatArray
from scex_sumo.results.densities import DENSITIES, densities_table
from scex_sumo.results.run import Run

X_UNIT, DENSITY_UNIT, SHARE_UNIT = 1e-3, 1e-4, 1e-4
_LEVELS = 9
"""Shares of critical children at which it is known how many independent children the design is worth."""


def curve_arrays(table: pa.Table, prefix: str, columns: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Curves of metric columns, numbered in their order, of those that have any.

    Args:
        table: of densities.
        prefix: of the names.
        columns: metric columns.

    Returns:
        ``PREFIXn`` (P, 3) x, density, and share at or below x, in `X_UNIT`, `DENSITY_UNIT` and `SHARE_UNIT`;
        ``PREFIXn_atoms`` (A, 2) value and share.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for number, column in enumerate(columns):
        rows = table.filter(pc.equal(table["metric"], column))
        if not rows.num_rows:
            continue
        x, pdf, cdf, share = (np.asarray(rows[name]) for name in ("x", "pdf", "cdf", "atom"))
        found = np.stack([x / X_UNIT, pdf / DENSITY_UNIT, cdf / SHARE_UNIT], axis=1)
        arrays[f"{prefix}{number}"] = np.rint(found).astype(np.int64)
        arrays[f"{prefix}{number}_atoms"] = np.stack([x, share], axis=1)[share > 0]
    return arrays


def band_half_width(table: pa.Table, column: str) -> float:
    """Half-width of the band around the cumulative curve of a metric, as in the table; 0 without one."""
    rows = table.filter(pc.equal(table["metric"], column))
    above, below = (np.abs(np.asarray(rows[end]) - np.asarray(rows["cdf"])) for end in ("high", "low"))
    return float(max(above.max(initial=0.0), below.max(initial=0.0)))


def densities_of(run: Run) -> pa.Table:
    """The run's table of densities; made anew where its folder has none."""
    if (run.folder / DENSITIES).is_file():
        return run.table(DENSITIES)
    return densities_table(
        run.metrics, run.columns, run.intervals, reflect=bool(run.info.get("reflect", True))
    )


def effective_numbers(run: Run, sides: Iterable[str]) -> list[list[tuple[float, float]]]:
    """How many independent children those of the run are worth, by the share of critical ones.

    Args:
        run: a finished run.
        sides: on which each of its columns is critical.

    Returns:
        For each column pairs of share and number, ascending; the last one is of 1.
    """
    hits: list[FloatArray] = []
    shares: list[FloatArray] = []
    levels = np.arange(1, _LEVELS + 1) / (_LEVELS + 1)
    for column, side in zip(run.columns, sides, strict=True):
        values = run.values(column) * (1 if side == "left" else -1)
        known = values[~np.isnan(values)]
        limits = np.unique(np.quantile(known, levels, method="inverted_cdf")) if known.size else np.empty(0)
        with np.errstate(invalid="ignore"):
            hits.append(values[:, None] <= limits)
        shares.append(hits[-1].mean(axis=0))
    found = np.minimum(run.intervals.effective_number(np.concatenate(hits, axis=1).astype(float)), 1e9)
    ends = np.cumsum([share.size for share in shares])[:-1]
    return [
        [*zip(share.tolist(), number.tolist(), strict=True), (1.0, float(number[-1:].max(initial=run.children)))]
        for share, number in zip(shares, np.split(found, ends), strict=True)
    ]
