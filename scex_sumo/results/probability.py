"""Encounter of a run: how probable its events are, and in which futures they happen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.events import MEASURED
from scex_sumo.results.tables.encounters import QUESTIONS, share_of
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.statistics.density import Interval


class PairTables(Protocol):
    """Parts of a `Run` that tell what happens to a pair in each future."""

    @property
    def futures(self) -> int:
        """Number of futures."""

    @property
    def collisions(self) -> pa.Table:
        """Collisions by future and pair."""

    @property
    def pair_outcomes(self) -> pa.Table:
        """Values of the events by future and pair."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounter:
    """Encounter of two vehicles over all futures of a run.

    Attributes:
        row: of ``encounters.parquet``.
        run: that it belongs to.

    Example:
        >>> pair = run.encounter(run.encounters["track_id"][0].as_py(), run.encounters["other_id"][0].as_py())
        >>> 0 <= pair.collision.value <= 1
        True
    """

    row: Mapping[str, Any]
    run: PairTables = field(repr=False)

    @property
    def pair(self) -> tuple[int, int]:
        """Track ids, ascending."""
        one, other = sorted((self.row["track_id"], self.row["other_id"]))
        return one, other

    @property
    def collision(self) -> Interval:
        """Share of the futures in which the two collide."""
        return self.probability("collision")

    def probability(self, event: str) -> Interval:
        """Return the share of the futures with an event, one of `QUESTIONS`.

        It is at least that of a collision, which counts as each event.
        """
        if event not in QUESTIONS:
            raise UsageError(f"unknown event {event!r}; known: {', '.join(QUESTIONS)}")
        return share_of(self.row, event, self.run.futures)

    def happens(self, event: str) -> BoolArray:
        """Return (C,) whether an event, or any (``critical``), happens in each drawn future."""
        hits, outcomes = first_contacts(self.run.collisions), self.run.pair_outcomes
        struck = np.sort([np.asarray(hits["track_id"]), np.asarray(hits["other_id"])], axis=0)
        future = [np.asarray(hits["future"])[(np.array(self.pair) == struck.T).all(axis=1)]]
        a, b = (np.asarray(outcomes[name]) for name in ("track_a", "track_b"))
        own = (a == self.pair[0]) & (b == self.pair[1])
        for name, critical in critical_outcomes(outcomes).items():
            if event in (name, "critical"):
                future.append(np.asarray(outcomes["future"])[own & critical])
        happens: BoolArray = np.isin(np.arange(self.run.futures), np.concatenate(future))
        return happens


def critical_outcomes(outcomes: pa.Table) -> dict[str, BoolArray]:
    """Return by event the rows (N,) of `Run.pair_outcomes` in which it happens; not of collisions."""
    return {event.name: event.happens(np.asarray(outcomes[event.column])) for event in MEASURED}
