"""Exact probabilities of a run, read from ``exact.json``: influence tables of pairs, and their union."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.exact.tables import InfluenceTable, Weights, union_probability
from scex_sumo.statistics.density import Interval

EXACT: Final = "exact.json"
EVENTS: Final = ("collision", "ttc", "pet", "drac")
"""Events of a pair, as the columns of ``encounters.parquet``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Exact:
    """Influence tables of a run.

    Attributes:
        models: that vehicles draw from.
        shares: (M,) of the models.
        tables: by the two track ids, ascending, and the event; an event that never happened has none.
        sampled: events whose sampled value stays, with the reason.
        checked: number of drawn futures that checked the tables.
        extra: number of futures that were run for the tables.
    """

    models: tuple[str, ...]
    shares: np.ndarray[Any, np.dtype[np.float64]]
    tables: Mapping[tuple[int, int, str], InfluenceTable]
    sampled: Mapping[tuple[int, int, str], str]
    checked: int
    extra: int

    def table(self, one: int, other: int, event: str = "collision") -> InfluenceTable | None:
        """Return the table of a pair's event; None if its sampled value stays."""
        if event not in EVENTS:
            raise UsageError(f"unknown event {event!r}; known: {', '.join(EVENTS)}")
        key = (min(one, other), max(one, other), event)
        if key in self.sampled:
            return None
        return self.tables.get(key, self._never)

    @cached_property
    def _never(self) -> InfluenceTable:
        outcomes = np.zeros((), dtype=np.bool_)
        return InfluenceTable(
            track_ids=(), models=self.models, outcomes=outcomes, shares=self.shares, checked=self.checked
        )

    def p_collision(self, weights: Weights | None = None) -> float | None:
        """Return the exact probability of any collision; None if a pair that collides has no table."""
        if any(event == "collision" for _, _, event in self.sampled):
            return None
        tables = [table for (_, _, event), table in self.tables.items() if event == "collision"]
        return union_probability(tables, weights)

    @property
    def remainder(self) -> float:
        """Remainder of the least checked table of a collision."""
        return self._least.remainder

    @property
    def _least(self) -> InfluenceTable:
        tables = [table for (_, _, event), table in self.tables.items() if event == "collision"]
        return min([self._never, *tables], key=lambda table: table.checked)

    def told(self) -> str:
        """Return how the tables of collisions were checked, in words: the least checked one counts."""
        checked = f"checked on {self._least.checked} futures: none differs"
        return f"exact, {checked} (remainder {self.remainder:.1%})"


@dataclass(frozen=True, kw_only=True)
class CollisionShare(Interval):
    """Share of the futures with a collision, its interval, and the exact probability.

    Attributes:
        tables: None where the run has no exact probabilities.
    """

    tables: Exact | None = field(default=None, repr=False)

    @cached_property
    def exact(self) -> float | None:
        """Exact probability with the run's weights; None where a pair that collides has no table."""
        return None if self.tables is None else self.tables.p_collision()

    @property
    def percent(self) -> str:
        """In words, e.g. ``12 % [9–16]``, or ``12.5 %`` if it is exact."""
        return super().percent if self.exact is None else f"{100 * self.exact:.4g} %"

    def __call__(self, weights: Weights | None = None) -> float:
        """Return the exact probability of any collision, with other weights if they are given.

        Raises:
            UsageError: other weights are given, and some pair that collides has no exact table.
        """
        if weights is None:
            return self.value if self.exact is None else self.exact
        exact = None if self.tables is None else self.tables.p_collision(weights)
        if exact is not None:
            return exact
        raise UsageError("p_collision: not every pair that collides has an exact table; run with --exact")


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounter:
    """Encounter of two vehicles over all futures.

    Attributes:
        row: of ``encounters.parquet``.
        exact: tables of the run; None without.
    """

    row: Mapping[str, Any]
    exact: Exact | None

    def table_of(self, event: str = "collision") -> InfluenceTable | None:
        """Return the influence table of an event; None where its sampled value stays."""
        if self.exact is None:
            return None
        return self.exact.table(self.row["track_id"], self.row["other_id"], event)

    @property
    def table(self) -> InfluenceTable | None:
        """Influence table of the collision; None where its sampled value stays."""
        return self.table_of()

    def probability(self, event: str = "collision", *, weights: Weights | None = None) -> float:
        """Return the probability of an event, or of any (``critical``): exact with a table, else sampled.

        Raises:
            UsageError: an unknown event, or other weights for one without a table.
        """
        tables = [self.table_of(name) for name in (EVENTS if event == "critical" else (event,))]
        known = [table for table in tables if table is not None]
        exact = union_probability(known, weights) if len(known) == len(tables) else None
        if exact is not None:
            return exact
        if weights is not None:
            raise UsageError(f"{event}: has no exact table, and no value for other weights")
        return float(self.row[event])


def write_exact(found: Exact, file: Path) -> None:
    """Write ``exact.json``."""
    content = {
        "models": list(found.models),
        "shares": found.shares.tolist(),
        "checked": found.checked,
        "extra": found.extra,
        "events": [
            {
                "track_id": one,
                "other_id": other,
                "event": event,
                "vehicles": list(table.track_ids),
                "outcomes": "".join("01"[int(x)] for x in table.outcomes.reshape(-1)),
                "checked": table.checked,
            }
            for (one, other, event), table in sorted(found.tables.items())
        ],
        "sampled": [
            {"track_id": one, "other_id": other, "event": event, "why": why}
            for (one, other, event), why in sorted(found.sampled.items())
        ],
    }
    write_atomic(file, json.dumps(content).encode())


def remove_exact(folder: Path) -> None:
    """Remove the exact probabilities of an earlier run; the parts of an interrupted one stay."""
    (folder / EXACT).unlink(missing_ok=True)


def read_exact(folder: Path) -> Exact | None:
    """Read the exact probabilities of a result folder; None if it has none.

    Raises:
        ResultError: ``exact.json`` is damaged.
    """
    file = folder / EXACT
    if not file.is_file():
        return None
    try:
        content = json.loads(file.read_bytes())
        models, shares = tuple(content["models"]), np.array(content["shares"], dtype=np.float64)
        tables = {}
        for entry in content["events"]:
            vehicles = tuple(int(track) for track in entry["vehicles"])
            flat = np.array([character == "1" for character in entry["outcomes"]], dtype=np.bool_)
            tables[entry["track_id"], entry["other_id"], entry["event"]] = InfluenceTable(
                track_ids=vehicles,
                models=models,
                outcomes=flat.reshape((len(models),) * len(vehicles)),
                shares=shares,
                checked=int(entry["checked"]),
            )
        sampled = {(e["track_id"], e["other_id"], e["event"]): e["why"] for e in content["sampled"]}
        checked, extra = int(content["checked"]), int(content["extra"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None
    return Exact(models=models, shares=shares, tables=tables, sampled=sampled, checked=checked, extra=extra)
