"""Columns of all tables: their types by name; rows of arrays as tables and back."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import IntArray, Rows

R = TypeVar("R", bound=Rows)

_WHOLE = "future futures step track_id other_id track_a track_b first second moments rank vehicles"
_TEXTS = """
    name other_name person what how kind place doubt model other_model side other_side fault metric conflict
    location recording case seed failure verdict note hits other
"""
_FLAGS = "consequence to_test moving covered seen along_covered across_covered along_seen across_seen"
_TYPES = {
    **dict.fromkeys(_WHOLE.split(), pa.int64()),
    **dict.fromkeys(_TEXTS.split(), pa.string()),
    **dict.fromkeys(_FLAGS.split(), pa.bool_()),
}


def schema(*names: str | Iterable[str], **others: pa.DataType) -> pa.Schema:
    """Return the schema of a table.

    Args:
        names: of its columns in order: words of a text, or names. Those of no other type are float64.
        others: types that columns have in this table alone.
    """
    words = [word for group in names for word in (group.split() if isinstance(group, str) else group)]
    return pa.schema([(word, (_TYPES | others).get(word, pa.float64())) for word in words])


def rows_table(rows: Rows, futures: IntArray, **types: Any) -> pa.Table:
    """Return rows as a table, with the number of the future.

    Args:
        rows: with an index ``future``.
        futures: (C,) numbers.
        types: of columns that are smaller in a file.
    """
    columns = {field.name: getattr(rows, field.name) for field in fields(rows)}
    columns["future"] = np.asarray(futures)[columns["future"]]
    return pa.table({name: values.astype(types.get(name, values.dtype)) for name, values in columns.items()})


def rows_in(kind: type[R], table: pa.Table) -> R:
    """Return the rows of `rows_table`; ``future`` is the number of the future."""
    columns = {field.name: np.asarray(table[field.name]) for field in fields(kind)}
    return kind(**{k: v.astype(np.int64) if v.dtype.kind == "i" else v for k, v in columns.items()})
