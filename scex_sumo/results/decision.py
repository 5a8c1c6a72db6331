"""Verdict on the moment of a run, and its file ``decision.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from scex_sumo.base.errors import ResultError

DECISION: Final = "decision.json"

TEST: Final = "test"
NOTHING: Final = "nothing"
DISAGREE: Final = "disagree"
DOUBTFUL: Final = "doubtful"
VERDICTS: Final[Mapping[str, str]] = {
    TEST: "Test",
    NOTHING: "Nothing to test",
    DISAGREE: "The models disagree",
    DOUBTFUL: "Doubtful data",
}
"""Word of a verdict by its kind: a sentence begins with it."""


@dataclass(frozen=True, kw_only=True)
class Decision:
    """Verdict on a moment of traffic.

    Attributes:
        kind: ``test``, ``nothing``, ``disagree`` or ``doubtful``.
        sentence: the answer in words.
        pair: track ids of the pair that decides: a vehicle hits or follows another one; None without a pair.
        what: kind of the conflict, e.g. ``rear-end``; ``how`` it comes to it, in words.
        place: of the conflict, one of `scex_sumo.roads.places.PLACES`; None off the lanes.
        time_s: of the conflict, after the moment.
        future: human-like future that shows it.
        probability: of a contact of the pair within 3 s, between people.
        least: the same with contacts a tenth as frequent as published; ``most``: ten times.
        doubt: why the data of the pair are doubtful; None if they are not.

    Example:
        >>> run.decision is None or run.decision.kind in ("test", "nothing", "disagree", "doubtful")
        True
    """

    kind: str
    sentence: str
    pair: tuple[int, int] | None = None
    what: str | None = None
    how: str | None = None
    place: str | None = None
    time_s: float | None = None
    future: int | None = None
    probability: float = 0.0
    least: float = 0.0
    most: float = 0.0
    doubt: str | None = None

    def __post_init__(self) -> None:
        assert self.least <= self.probability <= self.most, "P lies within its range"


def read_decision(folder: Path) -> Decision | None:
    """Return the verdict in the folder of a finished run; None without one."""
    file = folder / DECISION
    if not file.is_file():
        return None
    try:
        content = json.loads(file.read_bytes())
        return Decision(**content | {"pair": content["pair"] and tuple(content["pair"])})
    except (OSError, ValueError, KeyError, TypeError, AssertionError) as error:
        raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None
