"""Driving functions under test as an extra of a run: its files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scex_sumo.extrapolation.extras import Extra
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.results.extras import BASELINE


@dataclass(frozen=True, kw_only=True)
class Baseline(Extra):
    """Every future again, with the vehicles under test driven as drawn, in the folder ``baseline/``."""

    order: ClassVar[int] = 5
    files: ClassVar[tuple[str, ...]] = (BASELINE,)
    methods: ClassVar[str] = "scex_sumo.studies.under_test.baseline:BaselineExtra"

    def is_on(self, settings: RunSettings) -> bool:
        """See `Extra`."""
        return any(model is not None for model in settings.under_test.values())
