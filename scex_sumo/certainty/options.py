"""Exact probabilities and critical responses as extras of a run: their options and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from scex_sumo.base.options import option
from scex_sumo.extrapolation.extras import Extra
from scex_sumo.extrapolation.settings import RunSettings

EXACT: Final = "exact.json"
"""Tables of exact probabilities in a result folder."""

FITTED: Final = "fitted_weights.json"
"""Weights of the models that were fitted to the recording, in a result folder."""

RESPONSE: Final = "response.parquet"
DECISION: Final = "decision.json"
MAPS: Final = "response_maps.json"
PEOPLE: Final = "people"


@dataclass(frozen=True, kw_only=True)
class ExactProbabilities(Extra):
    """Futures with chosen assignments, from which P of an event follows exactly, see docs/exact.md."""

    order: ClassVar[int] = 10
    files: ClassVar[tuple[str, ...]] = (EXACT, "exact", FITTED)
    methods: ClassVar[str] = "scex_sumo.certainty.extra:ExactExtra"

    exact: bool = option("Run some more futures for exact probabilities.", True)
    fit_weights: bool = option("Fit the models' weights to the recording.", False)

    def is_on(self, settings: RunSettings) -> bool:
        """See `Extra`."""
        return self.exact or self.fit_weights


@dataclass(frozen=True, kw_only=True)
class CriticalResponse(Extra):
    """What it takes until two vehicles collide, and how often people let it happen, see docs/response.md."""

    order: ClassVar[int] = 15
    files: ClassVar[tuple[str, ...]] = (RESPONSE, DECISION, MAPS)
    methods: ClassVar[str] = "scex_sumo.certainty.response.extra:ResponseExtra"

    response: str | None = option(
        "How people act and respond, or a file.", PEOPLE, metavar="people|FILE|none", takes=str
    )
    usual: str | None = option(
        "Finished ranking (or validation with --usual) of the same place.", None, metavar="RANKING", takes=str
    )

    def is_on(self, settings: RunSettings) -> bool:
        """See `Extra`."""
        return self.response not in (None, "none")

    def answer(self, run: Any) -> Mapping[str, Any]:
        """Return null for the keys of a run without critical responses."""
        return {"human_like": None, "response": None}
