"""Curves of a page: densities and cumulative curves of a run's own tables, as small integers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scex_sumo.arrays import BoolArray, FloatArray
from scex_sumo.results.densities import DENSITIES, densities_table
from scex_sumo.results.run import Run

Curves: TypeAlias = dict[str, dict[str, FloatArray]]
"""By metric column, arrays of one length: x, pdf, cdf, low, high, atom, as in ``densities.parquet``."""

X_UNIT, DENSITY_UNIT, SHARE_UNIT = 1e-3, 1e-4, 1e-4
_LEVELS = 9
"""Shares of critical children at which it is known how many independent children the design is worth."""


def curve_arrays(
    curves: Curves, prefix: str, views: Mapping[str, tuple[float, float]]
) -> dict[str, NDArray[Any]]:
    """Curves of metric columns, numbered in their order, of those that have any.

    Args:
        curves: of the columns.
        prefix: of the names.
        views: range of values that is seen, by metric column; the curves go on to its ends.

    Returns:
        ``PREFIXn`` (P, 3) x, density, and share at or below x, in `X_UNIT`, `DENSITY_UNIT` and `SHARE_UNIT`.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for number, (column, (low, high)) in enumerate(views.items()):
        rows = curves[column]
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


def curve_words(curves: Curves, likely: Curves | None, column: str) -> dict[str, Any]:
    """What is known of a metric's curves beside their points.

    Args:
        curves: of the columns.
        likely: the same of the likely children, where there are any.
        column: of a metric.

    Returns:
        ``atoms`` and ``likely_atoms`` with their shares, ``band`` its half-width, ``peak`` the largest
        density and ``most`` the largest share of an atom.
    """
    rows = [part[column] for part in (curves, likely) if part is not None]
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


def densities_of(run: Run, columns: Sequence[str]) -> Curves:
    """Densities of some metrics of a run; made anew where its folder has none."""
    if (run.folder / DENSITIES).is_file():
        table = run.table(DENSITIES)
    else:
        folded = bool(run.info.get("reflect", True))
        table = densities_table(run.metrics, run.columns, run.intervals, reflect=folded)
    coded = table["metric"].combine_chunks().dictionary_encode()
    number = {name: index for index, name in enumerate(coded.dictionary.to_pylist())}
    arrays = {name: np.asarray(table[name]) for name in table.column_names if name != "metric"}
    rows = {column: np.asarray(coded.indices) == number.get(column, -1) for column in columns}
    return {column: {name: values[mine] for name, values in arrays.items()} for column, mine in rows.items()}


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
