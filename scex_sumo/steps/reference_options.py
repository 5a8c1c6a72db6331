"""Human-like reference as an extra of a run: its option and files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scex_sumo.base.options import option
from scex_sumo.extrapolation.extras import Extra
from scex_sumo.extrapolation.settings import PEOPLE, RunSettings
from scex_sumo.results.extras import REFERENCE


@dataclass(frozen=True, kw_only=True)
class HumanReference(Extra):
    """Futures of human-like drivers beside those of a run, in its folder ``reference/``."""

    order: ClassVar[int] = 20
    files: ClassVar[tuple[str, ...]] = (REFERENCE,)
    methods: ClassVar[str] = "scex_sumo.steps.reference:ReferenceExtra"

    reference: str | None = option(
        "Human-like reference, run after the stress test.",
        "likely",
        metavar="MIX|none",
        panel=PEOPLE,
        takes=str,
    )

    def is_on(self, settings: RunSettings) -> bool:
        """See `Extra`."""
        return self.reference not in (None, "none")
