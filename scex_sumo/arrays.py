"""The arrays that everything passes on, and which rows of one are equal."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]


IntArray: TypeAlias = NDArray[np.int64]


BoolArray: TypeAlias = NDArray[np.bool_]


def distinct(rows: FloatArray) -> tuple[IntArray, IntArray]:
    """Which rows are equal to the bit.

    Args:
        rows: (n, K).

    Returns:
        (k,) the first row of each kind, ascending, and (n,) the kind of each row.
    """
    whole = np.ascontiguousarray(rows)
    number: dict[bytes, int] = {}
    kind = np.array([number.setdefault(row.tobytes(), len(number)) for row in whole], dtype=np.int64)
    return np.unique(kind, return_index=True)[1], kind
