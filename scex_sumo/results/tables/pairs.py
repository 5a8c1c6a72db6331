"""``pairs.parquet``: P of a contact of each pair between people, and how it is said."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa

from scex_sumo.results.tables.columns import schema

PAIRS_FILE: Final = "pairs.parquet"

TOLD: Final = 1e-7
"""P below which nobody asks how it comes to it."""

NARROW: Final = "\u202f"  # no-break space within a number

PAIRS: Final = schema(
    "track_id other_id name other_name person probability least most what how place future futures collide",
    "needed_braking time_margin gap_m conflict_s speed_mps x y doubt",
    future=pa.int32(),
    futures=pa.int32(),
)
"""Columns of ``pairs.parquet``: one row a pair.

``track_id`` is that of the vehicle which has to brake, or enters later: it hits or follows the other one.
``name`` is SUMO's in a simulation, ``person`` kind and name of a pedestrian or cyclist. ``probability`` is of
a contact within 3 s, ``least`` and ``most`` with contacts a tenth and ten times as frequent, or the error of
few futures. ``what`` is one of `scex_sumo.decision.words.WHAT`, ``place`` one of `roads.places.PLACES`, null
off the lanes. ``future`` has the largest P but one, ``futures`` have a tenth of its P or more, ``collide`` is
the share of the futures with a contact. In that future: ``needed_braking`` in m/s² (0: none), ``time_margin``
in s (null: they do not cross), least ``gap_m``, ``conflict_s`` after the moment, ``speed_mps`` between the
two, ``x`` and ``y`` of the first one then.
"""


def told_pairs(run: Any, *, doubtful: bool = False) -> list[dict[str, Any]]:
    """Return the rows of a finished run with a P that is told, the most probable first; [] without any.

    Args:
        run: a `Run`.
        doubtful: those whose data are doubtful, not the others.
    """
    if not (run.folder / PAIRS_FILE).is_file():
        return []
    rows = run.table(PAIRS_FILE).to_pylist()
    return [row for row in rows if row["probability"] >= TOLD and (row["doubt"] is not None) == doubtful]


def arrow(row: Mapping[str, Any]) -> str:
    """Return a pair in words: the vehicle that hits or follows, and the other one."""
    return " → ".join(ends(row))


def ends(row: Mapping[str, Any]) -> tuple[str, str]:
    """Return the names of both road users of a row of pairs or encounters; track ids of older ones."""
    name, other = (row.get(column) for column in ("name", "other_name"))
    return str(name or row["track_id"]), str(row.get("person") or other or row["other_id"])


def any_of(probabilities: Iterable[float]) -> float:
    """Return P of any of several events: 1 - Π (1 - P), as if independent."""
    return float(
        0.0 - np.expm1(np.log1p(-np.minimum(np.fromiter(probabilities, np.float64), 1 - 1e-12)).sum())
    )


def once_in(probability: float) -> str:
    """Return a probability as one of so many, `rounded`."""
    if probability >= 0.5:
        return f"in about {100 * probability:.0f}{NARROW}% of such moments"
    return f"about once in {one_in(probability)} such moments"


def one_in(probability: float) -> str:
    """Return the number of moments of which one has it, `rounded`; over 1 000 million at most."""
    return rounded(1 / max(probability, 1e-9))


def rounded(number: float) -> str:
    """Return a number with one digit, two where the first is 1; its thousands stay together."""
    size = 10 ** math.floor(math.log10(max(number, 1.0)))
    size = size // 10 if 10 <= number < 2 * size else size
    return f"{round(number / size) * size:,}".replace(",", NARROW)
