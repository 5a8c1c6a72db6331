"""Curves of a page: densities and cumulative curves of a run's own tables, as small integers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.results.densities import DENSITIES, densities_table
from scex_sumo.results.run import Run

X_UNIT, DENSITY_UNIT, SHARE_UNIT = 1e-3, 1e-4, 1e-4
_LEVELS = 9
"""Shares of critical children at which it is known how many independent children the design is worth."""


def curve_arrays(
    table: pa.Table, prefix: str, views: Mapping[str, tuple[float, float]]
) -> dict[str, NDArray[Any]]:
    """Curves of metric columns, numbered in their order, of those that have any.

    Args:
        table: of densities.
        prefix: of the names.
        views: range of values that is seen, by metric column; the curves go on to its ends.

    Returns:
        ``PREFIXn`` (P, 3) x, density, and share at or below x, in `X_UNIT`, `DENSITY_UNIT` and `SHARE_UNIT`.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for number, (column, (low, high)) in enumerate(views.items()):
        rows = _rows_of(table, column)
        x, cdf = rows["x"], rows["cdf"]
        if not x.size:
            continue
        before = [(low, 0.0, 0.0), (float(x[0]), 0.0, 0.0)] if low < x[0] else []
        after = [(float(x[-1]), 0.0, float(cdf[-1])), (high, 0.0, float(cdf[-1]))] if high > x[-1] else []
        whole = np.concatenate(
            [np.reshape(before, (-1, 3)), np.stack([x, rows["pdf"], cdf], axis=1), np.reshape(after, (-1, 3))]
        )
        found = np.rint(whole / (X_UNIT, DENSITY_UNIT, SHARE_UNIT))
        arrays[f"{prefix}{number}"] = found.astype(np.int64)
    return arrays


def curve_words(table: pa.Table, likely: pa.Table | None, column: str) -> dict[str, Any]:
    """What is known of a metric's curves beside their points.

    Args:
        table: of densities.
        likely: the same of the likely children, where there are any.
        column: of a metric.

    Returns:
        ``atoms`` and ``likely_atoms`` with their shares, ``band`` its half-width, ``peak`` the largest
        density and ``most`` the largest share of an atom.
    """
    rows = [_rows_of(part, column) for part in (table, likely) if part is not None]
    atoms = [
        [(x, share) for x, share in zip(part["x"].tolist(), part["atom"].tolist(), strict=True) if share > 0]
        for part in rows
    ]
    ends = np.concatenate([rows[0]["high"] - rows[0]["cdf"], rows[0]["cdf"] - rows[0]["low"]])
    return {
        "atoms": atoms[0],
        "likely_atoms": atoms[-1] if likely is not None else [],
        "band": float(ends.max(initial=0.0)),
        "peak": max(float(part["pdf"].max(initial=1e-9)) for part in rows),
        "most": max(float(part["atom"].max(initial=0.0)) for part in rows),
    }


def _rows_of(table: pa.Table, column: str) -> dict[str, FloatArray]:
    rows = table.filter(pc.equal(table["metric"], column)).drop_columns(["metric"])
    return {name: np.asarray(rows[name]) for name in rows.column_names}


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
    hits: list[BoolArray] = []
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
        [
            *zip(share.tolist(), number.tolist(), strict=True),
            (1.0, float(number[-1:].max(initial=run.children))),
        ]
        for share, number in zip(shares, np.split(found, ends), strict=True)
    ]
