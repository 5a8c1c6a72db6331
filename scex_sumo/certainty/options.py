"""Critical responses as an extra of a run: their options and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from scex_sumo.base.options import option
from scex_sumo.extrapolation.extras import Extra
from scex_sumo.extrapolation.settings import RunSettings

RESPONSE: Final = "response.parquet"
DECISION: Final = "decision.json"
MAPS: Final = "response_maps.json"
PEOPLE: Final = "people"


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
