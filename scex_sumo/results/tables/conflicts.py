"""Table of conflicts: one row for each pair and human-like future, ``conflicts.parquet``."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Final

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray

if TYPE_CHECKING:
    from scex_sumo.conflicts.pairs import Conflicts

CONFLICTS: Final = "conflicts.parquet"
"""Vehicles by index into `scex_sumo.results.participants.everybody` of the seed scene."""


def conflicts_table(conflicts: Conflicts, futures: IntArray) -> pa.Table:
    """Return rows of `CONFLICTS`.

    Args:
        futures: (C,) numbers of the futures.
    """
    columns = {field.name: getattr(conflicts, field.name) for field in fields(conflicts)}
    columns["future"] = futures[conflicts.future].astype(np.int32)
    return pa.table(columns)


def conflicts_of(table: pa.Table) -> Conflicts:
    """Return the conflicts of a table; ``future`` is the number of the future."""
    from scex_sumo.conflicts.pairs import Conflicts

    names = (field.name for field in fields(Conflicts))
    return Conflicts(**{name: np.asarray(table[name].combine_chunks()) for name in names})
