"""Exact probabilities of a run, read from ``exact.json``: influence tables of pairs, and their union."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import pyarrow as pa

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.certainty.tables import InfluenceTable, Weights, shares_of, union_probability
from scex_sumo.metrics.encounters import CRITICAL_DRAC, CRITICAL_PET_S, CRITICAL_TTC_S
from scex_sumo.metrics.registry import COLLISION
from scex_sumo.statistics.density import Interval

EXACT: Final = "exact.json"
EVENTS: Final = ("collision", "ttc", "pet", "drac")
"""Events of a pair, as the columns of ``encounters.parquet``."""

MIN_EFFECTIVE: Final = 20
"""Effective drawn futures below which other weights have no sampled value."""

_LIMITS = {
    "ttc": ("min_ttc_path", CRITICAL_TTC_S, -1),
    "pet": ("min_pet", CRITICAL_PET_S, -1),
    "drac": ("max_drac", CRITICAL_DRAC, 1),
}  # column of `Run.pair_outcomes`, threshold, 1 if critical above it


class RunTables(Protocol):
    """Parts of a finished run that its probabilities need."""

    info: Any

    @property
    def children(self) -> int:
        """Number of drawn futures."""
        ...

    @property
    def exact(self) -> Exact | None:
        """Exact tables; None without."""
        ...

    @property
    def metrics(self) -> pa.Table:
        """One row a future."""
        ...

    @property
    def assignments(self) -> pa.Table:
        """Model of each vehicle."""
        ...

    @property
    def collisions(self) -> pa.Table:
        """Collisions by future and pair."""
        ...

    @property
    def pair_outcomes(self) -> pa.Table:
        """TTC, DRAC and PET by future and pair."""
        ...


class TooFewFuturesError(UsageError):
    """Too few of the drawn futures are driven as other weights ask."""


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
        run: that it belongs to.
    """

    run: RunTables = field(repr=False, compare=False)

    @property
    def tables(self) -> Exact | None:
        """Exact tables of the run; None where it has none."""
        return self.run.exact

    @cached_property
    def exact(self) -> float | None:
        """Exact probability with the run's weights; None where a pair that collides has no table."""
        return None if self.tables is None else self.tables.p_collision()

    @property
    def best(self) -> Interval:
        """The exact probability, else the share."""
        if self.exact is not None:
            return Interval(value=self.exact, low=self.exact, high=self.exact, count=self.count)
        return self

    @property
    def percent(self) -> str:
        """In words, e.g. ``12 % [9–16]``, ``12.5 %`` if it is exact."""
        return super().percent if self.exact is None else f"{100 * self.exact:.4g} %"

    def __call__(self, weights: Weights | None = None) -> float:
        """Return the probability of any collision, exact where all pairs that collide have tables.

        Args:
            weights: other weights of the models; without tables they weight the drawn futures.

        Raises:
            TooFewFuturesError: hardly any drawn future is driven like this.
        """
        if weights is None:
            return self.value if self.exact is None else self.exact
        exact = None if self.tables is None else self.tables.p_collision(weights)
        if exact is not None:
            return exact
        hit = np.asarray(self.run.metrics[COLLISION]).astype(np.bool_)
        return weighted_share(hit, future_weights(self.run, weights), "any collision")


@dataclass(frozen=True, kw_only=True, eq=False)
class Encounter:
    """Encounter of two vehicles over all futures.

    Attributes:
        row: of ``encounters.parquet``.
        run: that it belongs to.
    """

    row: Mapping[str, Any]
    run: RunTables

    def table_of(self, event: str = "collision") -> InfluenceTable | None:
        """Return the influence table of an event; None where its sampled value stays."""
        exact = self.run.exact
        return None if exact is None else exact.table(self.row["track_id"], self.row["other_id"], event)

    @property
    def table(self) -> InfluenceTable | None:
        """Influence table of the collision; None where its sampled value stays."""
        return self.table_of()

    def probability(self, event: str = "collision", *, weights: Weights | None = None) -> float:
        """Return the probability of an event, or of any (``critical``): exact with a table, else sampled.

        Without a table, other weights weight the drawn futures (importance sampling).

        Raises:
            UsageError: an unknown event.
            TooFewFuturesError: hardly any drawn future is driven like this.
        """
        tables = [self.table_of(name) for name in (EVENTS if event == "critical" else (event,))]
        known = [table for table in tables if table is not None]
        exact = union_probability(known, weights) if len(known) == len(tables) else None
        if exact is not None:
            return exact
        if weights is None:
            return float(self.row[event])
        return weighted_share(self.happens(event), future_weights(self.run, weights), event)

    def weighted(self, weights: Weights) -> dict[str, float | None]:
        """Return the probability of each event with other weights; None for too few futures like these."""
        found: dict[str, float | None] = {}
        for event in EVENTS:
            found[event] = None
            with suppress(TooFewFuturesError):
                found[event] = self.probability(event, weights=weights)
        return found

    def happens(self, event: str) -> BoolArray:
        """Return (C,) whether an event, or any (``critical``), happens in each drawn future."""
        pair = np.sort([self.row["track_id"], self.row["other_id"]])
        hits, outcomes = self.run.collisions, self.run.pair_outcomes
        struck = np.sort([np.asarray(hits["track_id"]), np.asarray(hits["other_id"])], axis=0)
        child = [np.asarray(hits["child"])[(pair == struck.T).all(axis=1)]]
        own = (np.asarray(outcomes["track_a"]) == pair[0]) & (np.asarray(outcomes["track_b"]) == pair[1])
        for name, critical in critical_outcomes(outcomes).items():
            if event in (name, "critical"):
                child.append(np.asarray(outcomes["child"])[own & critical])
        found: BoolArray = np.isin(np.arange(self.run.children), np.concatenate(child))
        return found


def critical_outcomes(outcomes: pa.Table) -> dict[str, BoolArray]:
    """Return by event the rows (N,) of `Run.pair_outcomes` in which it happens; not of collisions."""
    return {
        name: side * np.asarray(outcomes[column]) > side * limit
        for name, (column, limit, side) in _LIMITS.items()
    }


def future_weights(run: RunTables, weights: Weights) -> FloatArray:
    """Return (C,) how much likelier each drawn future is with other weights of the models.

    Args:
        weights: as of `shares_of`.
    """
    drawn = {entry["model"]: float(entry["weight"]) for entry in run.info["models"] if entry["weight"] > 0}
    names = list(drawn)
    shares = np.array(list(drawn.values())) / sum(drawn.values())
    before = np.full(len(names), 1 / len(names)) if run.info["design"] == "all" else shares
    tracks, fixed = run.info["seed_scene"]["track_ids"], run.info["assign"]
    models = np.array(run.assignments["model"].to_pylist()).reshape(run.children, len(tracks))
    ratio = np.ones(run.children)
    for column, (track, new) in enumerate(shares_of(tracks, names, shares, weights).items()):
        if str(track) not in fixed:
            ratio *= (new / before)[[names.index(model) for model in models[:, column].tolist()]]
    return ratio


def weighted_share(happens: BoolArray, ratio: FloatArray, what: str) -> float:
    """Return the share of weighted futures (C,) in which an event happens.

    Raises:
        TooFewFuturesError: the weights rest on fewer than `MIN_EFFECTIVE` futures (Kish 1965).
    """
    effective = float(ratio.sum() ** 2 / max((ratio**2).sum(), 1e-300))
    if effective < MIN_EFFECTIVE:
        raise TooFewFuturesError(
            f"{what}: has no exact table, and hardly any drawn future is driven like this ({effective:.1f} "
            f"effective futures, at least {MIN_EFFECTIVE} needed); run again with these weights in --models"
        )
    return float(ratio @ happens / ratio.sum())


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
                "cut_sets": [sorted(cube) for cube in table.cut_sets],
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
            vehicles = [int(track) for track in entry["vehicles"]]
            cubes = [{int(track): int(level) for track, level in cut_set} for cut_set in entry["cut_sets"]]
            table = InfluenceTable.of_cubes(cubes, vehicles, models, shares, int(entry["checked"]))
            tables[entry["track_id"], entry["other_id"], entry["event"]] = table
        sampled = {(e["track_id"], e["other_id"], e["event"]): e["why"] for e in content["sampled"]}
        checked, extra = int(content["checked"]), int(content["extra"])
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None
    return Exact(models=models, shares=shares, tables=tables, sampled=sampled, checked=checked, extra=extra)
