"""Events of two vehicles in a future: a collision, and a TTC, PET or DRAC beyond a threshold.

`EVENTS` is the only table of them. Columns of results, exact tables, words, the page and forecasts follow it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Event:
    """Event of two vehicles in a future: a value is beyond a threshold.

    Attributes:
        name: column of its probability in ``encounters.parquet``, with ``_low`` and ``_high``.
        value: attribute of `Encounters`.
        title: of columns in tables.
        measure: name of the value in full.
        critical: ``min`` if small values are critical, else ``max``.
        column: of the value in ``pair_outcomes.parquet``; empty for collisions, which have a file.
    """

    name: str
    value: str
    title: str
    measure: str
    threshold: float
    critical: Literal["min", "max"]
    unit: str = ""
    column: str = ""

    @property
    def side(self) -> Literal[-1, 1]:
        """1 if values above the threshold are critical, else -1."""
        return 1 if self.critical == "max" else -1

    @property
    def words(self) -> str:
        """What happens, in words, e.g. ``TTC < 1.5 s``."""
        limit = f" {'<' if self.side < 0 else '>'} {self.threshold:g} {self.unit}" if self.column else ""
        return f"{self.title}{limit}"

    @property
    def question(self) -> str:
        """What happens, with the name of the value in full."""
        return self.words.replace(self.title, self.measure, 1)

    def defined(self, values: FloatArray) -> FloatArray:
        """Return values (N,), NaN where undefined: inf, or 0 if large values are critical."""
        return np.where(values == (np.inf if self.side < 0 else 0.0), np.nan, values)

    def happens(self, values: FloatArray) -> BoolArray:
        """Return whether values are beyond the threshold; NaN is not."""
        return np.asarray(self.side * values > self.side * self.threshold)


# drivers rarely brake harder than 3.4 m/s² (Archer 2005)
EVENTS: Final[Mapping[str, Event]] = {
    "collision": Event("collision", "collided", "collides", "collision", 0.0, "max"),
    "ttc": Event("ttc", "ttc", "TTC", "TTC on path", 1.5, "min", "s", "min_ttc_path"),
    "pet": Event("pet", "pet", "PET", "PET", 1.0, "min", "s", "min_pet"),
    "drac": Event("drac", "drac", "DRAC", "DRAC", 3.4, "max", "m/s²", "max_drac"),
}
"""Events by name, in the order of all tables. A collision counts as each."""

MEASURED: Final = tuple(event for event in EVENTS.values() if event.column)
"""Events of a measured value: all but the collision."""
