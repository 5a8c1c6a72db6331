"""Metric: a formula, how its values are aggregated and judged, and what it is called."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from scex_sumo.metrics.pairs.scenes import Samples, Scenes


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One nanoscopic metric and how it is aggregated.

    Attributes:
        name: the column's name.
        critical: ``min`` where small values are critical, ``max`` where large ones are.
        evaluate: values of all pairs (or vehicles) of a batch of scenes.
        unit: of the nanoscopic value.
        inverse: aggregated as 1 / value (an infinite time becomes 0 1/s); ``critical``, ``threshold`` and
            ``label`` refer to the inverse.
        finite: infinite values are left out of the aggregates.
        threshold: from which aggregated value on a child is critical; None for none.
        label: name in tables and pictures; empty for that of the column.
    """

    name: str
    critical: Literal["min", "max"]
    evaluate: Callable[[Scenes], Samples]
    unit: str = ""
    inverse: bool = False
    finite: bool = False
    threshold: float | None = None
    label: str = ""

    @property
    def columns(self) -> tuple[str, str]:
        """Column of the most critical value, and of the mean over the scenes."""
        return self.name, f"{self.name}_mean"

    @property
    def side(self) -> Literal["left", "right"]:
        """On which side of a threshold values are critical."""
        return "left" if self.critical == "min" else "right"

    @property
    def words(self) -> str:
        """Name in tables and pictures."""
        return self.label or self.name

    @property
    def column_unit(self) -> str:
        """Unit of the columns; empty for none."""
        return f"1/{self.unit}" if self.inverse and self.unit else self.unit

    def titled(self, without: str = "") -> str:
        """Name and unit, as ``gap time [s]``; ``without`` stands in brackets for no unit."""
        unit = self.column_unit or without
        return f"{self.words} [{unit}]" if unit else self.words

    def description(self) -> dict[str, Any]:
        """All but the formula, as JSON."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "evaluate"}
