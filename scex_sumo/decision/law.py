"""Law of contact: P that what two vehicles come to in a human-like future ends in a contact.

People hardly ever let it come to a need of more than 2 m/s². The share that does falls exponentially with the
need, and so it does with the time margin. The scales are counted in recordings, the levels are those of
published contacts. The numbers are in ``law.json``, each with its unit and source.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.conflicts.pairs import Conflicts
from scex_sumo.converters.tracks.road_users import road_user

FILE: Final = Path(__file__).with_name("law.json")


@dataclass(frozen=True, kw_only=True)
class Law:
    """Parameters of the law.

    Attributes:
        braking_limit_mps2: hardest braking by kind of road user; others brake as a car.
        braking_scale_mps2: a need that is less than the limit by so much more is e times less dangerous.
        margin_level: P of a contact where one enters as the other one leaves.
        margin_scale_s: so much more margin is e times less dangerous.
        gap_level: P of a contact of two that pass without distance.
        gap_scale_m: so much more distance is e times less dangerous.
        level_factor: by which the levels are known, either way.
    """

    braking_limit_mps2: dict[str, float]
    braking_scale_mps2: float
    margin_level: float
    margin_scale_s: float
    gap_level: float
    gap_scale_m: float
    level_factor: float

    def limits(self, types: Sequence[str]) -> FloatArray:
        """Return the hardest braking (V,) of road users by type, m/s²."""
        car = self.braking_limit_mps2["car"]
        return np.array([self.braking_limit_mps2.get(road_user(kind), car) for kind in types])

    def contact(self, conflicts: Conflicts, types: Sequence[str]) -> FloatArray:
        """Return P(contact) of each row (N,): 1 after a contact, and where no braking helps any more.

        Args:
            types: (V,) of all vehicles.
        """
        braking, margin, gap = self.parts(conflicts, types)
        return np.asarray(np.where(conflicts.gap <= 0, 1.0, 1 - (1 - braking) * (1 - margin) * (1 - gap)))

    def parts(self, conflicts: Conflicts, types: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (N,) P by the needed braking, by the time margin, and by the gap."""
        limit = self.limits(types)[np.where(conflicts.brakes_one, conflicts.one, conflicts.two)]
        short = np.maximum(limit - conflicts.braking, 0.0) / self.braking_scale_mps2
        braking = np.where(conflicts.braking > 0, np.exp(-short), 0.0)
        margin = self.margin_level * np.exp(-conflicts.margin / self.margin_scale_s)
        return braking, margin, self.gap_level * np.exp(-conflicts.gap / self.gap_scale_m)


@cache
def law() -> Law:
    """Return the law that is shipped."""
    content = json.loads(FILE.read_text(encoding="utf-8"))
    return Law(**{name: entry["value"] for name, entry in content.items()})


def over_futures(pair: IntArray, contact: FloatArray, *, pairs: int, futures: int) -> FloatArray:
    """Return P(contact) (K,) of K pairs: the cube of the mean over futures of the cube root of P in each.

    Models of drivers collide far more often than drivers do (benchmarks/near_misses.py). So what one future
    in ten shows counts as once in a thousand, and what all show counts whole. The largest P counts as the
    second one: what a single future shows is its drivers'.

    Args:
        pair: (N,) number of each row's pair; a future without a row counts 0.
        contact: (N,) P in one future.
    """
    return np.asarray((np.bincount(pair, roots(pair, contact, futures), minlength=pairs) / futures) ** 3)


def second_of_each(pair: IntArray, contact: FloatArray, futures: int) -> tuple[IntArray, IntArray]:
    """Return the rows with the largest P of each pair, and with the second one, or the same of one row."""
    order = np.lexsort((-contact, pair))
    first = np.flatnonzero(np.diff(pair[order], prepend=-1))
    last = np.append(first[1:], len(order)) - 1
    return order[first], order[np.minimum(first + (futures > 1), last)]


def roots(pair: IntArray, contact: FloatArray, futures: int) -> FloatArray:
    """Return the cube roots (N,) of P, the largest of each pair as the second one."""
    root: FloatArray = np.cbrt(contact)
    if len(root):
        largest, second = second_of_each(pair, contact, futures)
        alone = (largest == second) & (futures > 1)  # all other futures have none
        root[largest] = np.where(alone, 0.0, root[second])
    return root


def error_over_futures(pair: IntArray, contact: FloatArray, *, pairs: int, futures: int) -> FloatArray:
    """Return the factor (K,) by which `over_futures` may be off: a standard error of the mean of the roots.

    Args:
        pair: as of `over_futures`, like the others.
    """
    root = roots(pair, contact, futures)
    mean, square = (np.bincount(pair, v, minlength=pairs) / futures for v in (root, root * root))
    error = np.sqrt(np.maximum(square - mean**2, 0.0) / futures)
    return np.asarray(np.exp(3 * error / np.maximum(mean, 1e-12)))


def at_level(contact: FloatArray, factor: float) -> FloatArray:
    """Return P of each row if contacts were so many times as frequent; 0 and 1 stay."""
    with np.errstate(divide="ignore"):
        return np.asarray(-np.expm1(factor * np.log1p(-contact)))
