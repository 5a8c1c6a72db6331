"""Array types, and rows and entries found in arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]

R = TypeVar("R", bound="Rows")

_FACTOR = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Table of arrays of one length; a column may be None."""

    def take(self: R, index: IntArray | BoolArray | slice) -> R:
        """Select rows."""
        return replace(self, **{name: a if a is None else a[index] for name, a in self._columns()})

    @classmethod
    def join(cls: type[R], parts: Sequence[R]) -> R:
        """Concatenate the rows of tables."""
        columns = zip(*(table._columns() for table in parts), strict=True)
        arrays = {column[0][0]: [array for _, array in column] for column in columns}
        return cls(**{name: None if a[0] is None else np.concatenate(a) for name, a in arrays.items()})

    def _columns(self) -> list[tuple[str, Any]]:
        return [(f.name, getattr(self, f.name)) for f in fields(self)]


def clipped(values: FloatArray, low: FloatArray | float, high: FloatArray | float) -> FloatArray:
    """Return ``np.clip``, without its overhead for small arrays."""
    result: FloatArray = np.minimum(np.maximum(values, low), high)
    return result


def distinct(rows: FloatArray | IntArray) -> tuple[IntArray, IntArray]:
    """Find the distinct rows of an array (n, K), compared bit by bit.

    Returns:
        (k,) the first row of each kind, ascending, and (n,) the kind of each row.
    """
    bits = np.ascontiguousarray(rows).view(np.uint64)
    sums = bits @ np.cumprod(np.full(bits.shape[1], _FACTOR))
    _, first, kind = np.unique(sums, return_index=True, return_inverse=True)
    if not np.array_equal(bits, bits[first[kind]]):  # different rows with the same sum
        _, first, kind = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    number = np.empty(len(first), dtype=np.int64)
    number[np.argsort(first)] = np.arange(len(first))
    return np.sort(first), number[kind.reshape(-1)]


def least_of(group: IntArray, *keys: FloatArray | IntArray) -> IntArray:
    """Return the index (k,) of the least entry of each group that has any; the first of equal ones.

    Args:
        group: (n,) number of each entry's group.
        keys: (n,) values of the entries, the most important ones first.
    """
    index, count = np.arange(group.size), int(group.max(initial=-1)) + 1
    for key in keys:
        least = np.full(count, np.inf)
        np.minimum.at(least, group[index], key[index])
        index = index[key[index] == least[group[index]]]
    first = np.full(count, group.size)
    np.minimum.at(first, group[index], index)
    return first[first < group.size]


def between(values: FloatArray, position: FloatArray) -> FloatArray:
    """Return values (n, T) at positions (T,) between columns (n, K), linear; the last column goes on.

    The same bytes for a row in any batch, other than by a matrix product.
    """
    low = np.clip(position.astype(np.int64), 0, values.shape[1] - 2)
    share = np.clip(position - low, 0.0, 1.0)
    result: FloatArray = values[:, low] * (1 - share) + values[:, low + 1] * share
    return result


def numbers_in(column: Any) -> FloatArray:
    """Return a column (n,) of an Arrow table as numbers, NaN where it is null."""
    return np.array(column.cast("double").fill_null(np.nan))
