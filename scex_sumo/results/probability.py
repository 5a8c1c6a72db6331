"""Probability of an event over the futures of a run: sampled, and exact where an extra knows it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray
from scex_sumo.base.errors import UsageError
from scex_sumo.metrics.events import EVENTS, MEASURED
from scex_sumo.results.extras import ExactProbability, extras_results
from scex_sumo.results.tables.outcomes import first_contacts
from scex_sumo.statistics.density import Interval


class PairTables(Protocol):
    """Parts of a `Run` that tell what happens to a pair in each future."""

    @property
    def folder(self) -> Path:
        """Result folder."""

    @property
    def futures(self) -> int:
        """Number of futures."""

    @property
    def collisions(self) -> pa.Table:
        """Collisions by future and pair."""

    @property
    def pair_outcomes(self) -> pa.Table:
        """Values of the events by future and pair."""


@dataclass(frozen=True, kw_only=True)
class Probability:
    """Probability of an event in a future.

    Attributes:
        sampled: share of the futures with the event, and its 95 % interval.
        known: the exact probability; None where it is not known.

    Example:
        >>> run.collision.sampled.value, run.collision.exact, run.collision.estimate.value
        (0.0, None, 0.0)
    """

    sampled: Interval
    known: ExactProbability | None = None

    @property
    def exact(self) -> float | None:
        """The exact probability; None where it is not known."""
        return None if self.known is None else self.known.value

    @property
    def estimate(self) -> Interval:
        """The exact probability where it is known, else the sampled share; all places print this one."""
        if self.known is None:
            return self.sampled
        return Interval(
            value=self.known.value, low=self.known.value, high=self.known.value, count=self.sampled.count
        )

    @property
    def percent(self) -> str:
        """The estimate in words, e.g. ``12 % [9–16]``, or ``12 %`` if it is exact."""
        return self.sampled.percent if self.known is None else self.known.percent

    @property
    def share(self) -> str:
        """The estimate in words, without its interval."""
        return self.sampled.share if self.known is None else self.known.percent

    @property
    def words(self) -> str:
        """The estimate in words, with how an exact one was checked."""
        return self.percent if self.known is None else f"{self.percent}; {self.known.checked}"


def probability_of(
    run: PairTables, sampled: Interval, event: str, pair: tuple[int, int] | None = None
) -> Probability:
    """Return the probability of an event of a pair, or of any pair: exact where an extra knows it."""
    known = (extra.exact_probability(run, event, pair) for extra in extras_results(run.folder))
    return Probability(sampled=sampled, known=next((one for one in known if one is not None), None))


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounter:
    """Encounter of two vehicles over all futures of a run.

    Attributes:
        row: of ``encounters.parquet``.
        run: that it belongs to.

    Example:
        >>> pair = run.encounter(run.encounters["track_id"][0].as_py(), run.encounters["other_id"][0].as_py())
        >>> 0 <= pair.collision.estimate.value <= 1
        True
    """

    row: Mapping[str, Any]
    run: PairTables = field(repr=False)

    @property
    def pair(self) -> tuple[int, int]:
        """Track ids, ascending."""
        one, other = sorted((self.row["track_id"], self.row["other_id"]))
        return one, other

    @cached_property
    def collision(self) -> Probability:
        """Probability that the two collide."""
        return self.probability("collision")

    def probability(self, event: str) -> Probability:
        """Return the probability of an event, a column of ``encounters.parquet`` such as ``critical``.

        It is at least that of a collision, which counts as each event.
        """
        if event not in (*EVENTS, "critical"):
            raise UsageError(f"unknown event {event!r}; known: {', '.join(EVENTS)}, critical")
        # A collision counts as each event, and may have an exact probability where the event has none.
        least = 0.0 if event == "collision" else self.collision.exact or 0.0
        count = round(float(self.row[event]) * self.run.futures)
        ends = {end: max(float(self.row[event + name]), least) for end, name in _ENDS.items()}
        return probability_of(self.run, Interval(**ends, count=count), event, self.pair)

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


_ENDS = {"value": "", "low": "_low", "high": "_high"}


def critical_outcomes(outcomes: pa.Table) -> dict[str, BoolArray]:
    """Return by event the rows (N,) of `Run.pair_outcomes` in which it happens; not of collisions."""
    return {event.name: event.happens(np.asarray(outcomes[event.column])) for event in MEASURED}
