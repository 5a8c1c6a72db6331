"""Metric: a formula, how its values are aggregated and judged, and what it is called."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from scex_sumo.errors import UsageError
from scex_sumo.metrics.pairs.entries import Entries
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
        harmonic: the mean over scenes is 1 / mean(1 / value), infinite values counting as 0 there.
        preset: rule for car-following that it is always evaluated by; None for that of the evaluation.
        quick: the same extrema of scenes from fewer pairs; None to evaluate all.
        threshold: from which aggregated value on a child is critical; None for none.
        label: name in tables and pictures; empty for that of the column.
    """

    name: str
    critical: Literal["min", "max"]
    evaluate: Callable[[Scenes], Samples | Entries]
    unit: str = ""
    inverse: bool = False
    finite: bool = False
    harmonic: bool = False
    preset: str | None = None
    quick: Callable[[Scenes], Samples] | None = None
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
        """All as JSON, with where the formula stands and the SHA-256 of that file in place of the formula."""
        told = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in _CODE}
        function = inspect.unwrap(self.evaluate)
        place = f"{getattr(function, '__module__', '')}:{getattr(function, '__qualname__', '')}"
        try:
            code = Path(inspect.getfile(function)).read_bytes()
        except (OSError, TypeError):  # typed into an interpreter, or no function of Python's
            return {**told, "function": place, "sha256": None}
        return {**told, "function": place, "sha256": hashlib.sha256(code).hexdigest()}

    @classmethod
    def described(cls, description: Mapping[str, Any]) -> Metric:
        """A metric that can be named and judged, but not evaluated, from its description."""
        names = [f.name for f in dataclasses.fields(cls) if f.name not in _CODE]
        known = {name: description[name] for name in names if name in description}
        return cls(evaluate=_elsewhere, **known)


_CODE = ("evaluate", "quick")  # attributes that are functions


def _elsewhere(scenes: Scenes) -> Samples | Entries:
    raise UsageError("metrics: this metric is known from a result only; register its function to evaluate it")
