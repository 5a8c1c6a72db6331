"""Metric: a formula with its name, unit, threshold and rule of aggregation."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.pairs.scenes import Entries, Samples, Scenes


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One nanoscopic metric and its aggregation.

    Attributes:
        evaluate: computes the values of all pairs (or vehicles) of a batch of scenes.
    """

    name: str
    critical: Literal["min", "max"]  # ``min`` if small values are critical, else ``max``
    evaluate: Callable[[Scenes], Samples | Entries]
    unit: str = ""
    inverse: bool = False  # aggregate 1 / value; ``critical``, ``threshold`` and ``label`` refer to it
    finite: bool = False  # leave infinite values out of the aggregates
    harmonic: bool = False  # the mean over scenes is 1 / mean(1 / value); infinite values count as 0
    preset: str | None = None  # car-following rule; None uses that of the evaluation
    quick: Callable[[Scenes], Samples] | None = None  # computes the same extrema from fewer pairs
    threshold: float | None = None  # value from which a child is critical
    label: str = ""  # name in tables and pictures; else the column's

    @property
    def columns(self) -> tuple[str, str]:
        """Columns of the most critical value and of the mean over scenes."""
        return self.name, f"{self.name}_mean"

    @property
    def side(self) -> Literal["left", "right"]:
        """Critical side of the threshold."""
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
        """Return name and unit, as ``gap time [s]``; ``without`` replaces a missing unit."""
        unit = self.column_unit or without
        return f"{self.words} [{unit}]" if unit else self.words

    def description(self) -> dict[str, Any]:
        """Return the attributes as JSON, with the formula's import path and its file's SHA-256."""
        attributes = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in _CODE}
        function = inspect.unwrap(self.evaluate)
        place = f"{getattr(function, '__module__', '')}:{getattr(function, '__qualname__', '')}"
        try:
            code = Path(inspect.getfile(function)).read_bytes()
        except (OSError, TypeError):  # an interpreter's function, or none of Python
            return {**attributes, "function": place, "sha256": None}
        return {**attributes, "function": place, "sha256": hashlib.sha256(code).hexdigest()}

    @classmethod
    def described(cls, description: Mapping[str, Any]) -> Metric:
        """Build from a description a metric without its formula."""
        names = [f.name for f in dataclasses.fields(cls) if f.name not in _CODE]
        return cls(evaluate=_no_formula, **{name: description[name] for name in names if name in description})


_CODE = ("evaluate", "quick")  # functions


def _no_formula(scenes: Scenes) -> Samples | Entries:
    raise UsageError("metrics: this metric is known from a result only; register its function to evaluate it")
