"""Columns of all tables: their types by name."""

from __future__ import annotations

from collections.abc import Iterable

import pyarrow as pa

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
    words = [word for part in names for word in (part.split() if isinstance(part, str) else part)]
    return pa.schema([(word, (_TYPES | others).get(word, pa.float64())) for word in words])
