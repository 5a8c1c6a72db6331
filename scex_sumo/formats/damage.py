"""Damaged files: what readers of other tools' files raise on them, as errors of one line."""

from __future__ import annotations

import csv
import re
import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import shapely

from scex_sumo.base.errors import InputError

MAX_ITEMS = 10**8  # of a table, those in lists too
_DAMAGE = (
    *(LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RuntimeError, MemoryError),
    *(EOFError, zlib.error, csv.Error, sqlite3.Error, shapely.errors.ShapelyError),
)


@contextmanager
def refusing_damage(error: type[InputError], path: Path, what: str) -> Iterator[None]:
    """Turn what a reader raises on a damaged file into an error of one line; ``what`` is no article."""
    try:
        yield
    except InputError as known:
        raise error(str(known)) from None
    except OSError as why:
        reason = " ".join(str(why.strerror or why).split())[:160]  # Arrow's has lines
        raise error(f"{path}: cannot be read ({reason}); check the file") from None
    except KeyError as key:
        name = re.sub(r"""(?s).*?["'](.*?)["'].*""", r"\1", str(key.args[0]))  # in a sentence of Arrow
        raise error(f"{path}: no {name[:160]} in it; take the file as published") from None
    except _DAMAGE as why:
        reason = " ".join(str(why).split())[:160] or "it is damaged"
        raise error(f"{path}: no {what} can be read: {reason}; mend it, or fetch it again") from None


def checked(table: Any) -> Any:
    """Return a table of Arrow after a full check; raises `ValueError`.

    Few bytes can state billions of rows.
    """
    import pyarrow as pa

    table.validate(full=True)  # offsets of a damaged file lead out of its buffers
    items = 0
    for chunk in (chunk for column in table.columns for chunk in column.chunks):
        items += len(chunk)
        while pa.types.is_list(chunk.type) or pa.types.is_large_list(chunk.type):
            chunk = chunk.flatten()
            items += len(chunk)
    if items > MAX_ITEMS:
        raise ValueError(f"more than {MAX_ITEMS} values in it")
    return table
