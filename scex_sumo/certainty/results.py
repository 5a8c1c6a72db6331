"""Exact probabilities of a run, read from ``exact.json``: influence tables of pairs, and their union."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.certainty.options import EXACT
from scex_sumo.certainty.tables import Draws, InfluenceTable, Weights, union_probability
from scex_sumo.metrics.events import EVENTS
from scex_sumo.metrics.registry import COLLISION

if TYPE_CHECKING:
    from scex_sumo.results.run import Run

MIN_EFFECTIVE: Final = 20
"""Effective drawn futures below which other weights have no sampled value."""


class TooFewFuturesError(UsageError):
    """Too few of the drawn futures are driven as other weights ask."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Exact:
    """Influence tables of a run.

    Attributes:
        draws: the models that vehicles and people draw.
        tables: by the two track ids, ascending, and the event; an event that never happened has none.
        sampled: events whose sampled value stays, with the reason.
        checked: number of drawn futures that checked the tables.
        extra: number of futures that were run for the tables.

    Example:
        >>> isinstance(scex.exact_of(run), scex.Exact)  # too few futures to check tables
        False
    """

    draws: Draws
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
        return InfluenceTable(track_ids=(), draws=self.draws, outcomes=outcomes, checked=self.checked)

    def probability(
        self, event: str = COLLISION, pair: tuple[int, int] | None = None, weights: Weights | None = None
    ) -> float | None:
        """Return the exact probability of an event of a pair, or of any collision; None without a table.

        Args:
            event: one of `EVENTS`, or ``critical`` for any of them.
            pair: None for any pair that collides.
            weights: other weights of the models.
        """
        if pair is None:
            if event != COLLISION or any(name == COLLISION for _, _, name in self.sampled):
                return None
            tables = [table for (_, _, name), table in self.tables.items() if name == COLLISION]
            return union_probability(tables, weights)
        known = [self.table(*pair, name) for name in (EVENTS if event == "critical" else (event,))]
        tables = [table for table in known if table is not None]
        return union_probability(tables, weights) if len(tables) == len(known) else None

    def why_sampled(self, one: int, other: int, event: str = COLLISION) -> str:
        """Return why the sampled value of a pair's event stays; empty if its table is exact."""
        return self.sampled.get((min(one, other), max(one, other), event), "")

    @property
    def remainder(self) -> float:
        """Remainder of the least checked table of a collision."""
        return self._least.remainder

    @property
    def _least(self) -> InfluenceTable:
        tables = [table for (_, _, event), table in self.tables.items() if event == "collision"]
        return min([self._never, *tables], key=lambda table: table.checked)

    def summary(self) -> str:
        """Return how the tables of collisions were checked, in words: the least checked one counts."""
        return self._least.summary()


@checked
def weighted_probability(
    run: Run, weights: Weights, event: str = COLLISION, pair: tuple[int, int] | None = None
) -> float:
    """Return the probability of an event of a pair, or of any collision, with other weights of the models.

    It is exact where all pairs that count have tables; else weights of the drawn futures estimate it
    (importance sampling).

    Args:
        weights: by model, or by track id and model, as of `Draws.shares_of`.

    Raises:
        UsageError: a model is unknown, or a weight is below 0.
        TooFewFuturesError: hardly any drawn future is driven like this.

    Example:
        >>> try:
        ...     scex.weighted_probability(run, {"standard_driver": 1.0})
        ... except scex.ScexError as error:
        ...     print("4 futures are too few" if "hardly any" in str(error) else error)
        4 futures are too few
    """
    tables = exact_of(run)
    exact = None if tables is None else tables.probability(event, pair, weights)
    if exact is not None:
        return exact
    if pair is None:
        happens = np.asarray(run.metrics[COLLISION]).astype(np.bool_)
    else:
        happens = run.encounter(*pair).happens(event)
    return weighted_share(happens, future_weights(run, weights), event)


def future_weights(run: Run, weights: Weights) -> FloatArray:
    """Return (C,) how much likelier each drawn future is with other weights of the models.

    Args:
        weights: as of `Draws.shares_of`.
    """
    draws, tracks = _draws(run), run.info["seed_scene"]["track_ids"]
    models = np.array(run.assignments["model"].to_pylist()).reshape(run.futures, len(tracks))
    ratio = np.ones(run.futures)
    for column, (track, new) in enumerate(draws.shares_of(tracks, weights).items()):
        drawn = models[:, column].tolist()
        if str(track) in run.info["assign"] or not set(drawn) <= set(draws.models):
            continue
        before = draws.shares_of([track])[track]
        if run.info["design"] == "all":
            before = (before > 0) / np.count_nonzero(before)
        index = [draws.models.index(model) for model in drawn]
        ratio *= new[index] / before[index]
    return ratio


def _draws(run: Run) -> Draws:
    drawn = {entry["model"]: float(entry["weight"]) for entry in run.info["models"] if entry["weight"] > 0}
    kinds: list[dict[str, float]] = list(run.info.get("people", {}).values())
    walking = next((weights for weights in kinds if len(weights) > 1), {})
    return Draws.of(drawn, walking, run.info["seed_scene"].get("people", ()))


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


def write_exact(exact: Exact, file: Path) -> None:
    """Write ``exact.json``."""
    content = {
        "models": list(exact.draws.models),
        "shares": exact.draws.shares.tolist(),
        **people_of(exact.draws),
        "checked": exact.checked,
        "extra": exact.extra,
        "events": [
            {
                "track_id": one,
                "other_id": other,
                "event": event,
                "vehicles": list(table.track_ids),
                "cut_sets": [sorted(cube) for cube in table.cut_sets],
                "checked": table.checked,
            }
            for (one, other, event), table in sorted(exact.tables.items())
        ],
        "sampled": [
            {"track_id": one, "other_id": other, "event": event, "why": why}
            for (one, other, event), why in sorted(exact.sampled.items())
        ],
    }
    write_atomic(file, json.dumps(content).encode())


def people_of(draws: Draws) -> dict[str, Any]:
    """Return the JSON entries of people that draw models; none without any."""
    names = {"people": sorted(draws.people), "of_people": sorted(draws.of_people)}
    return names if draws.people else {}


@checked
@owner_cache
def exact_of(run: Run) -> Exact | None:
    """Return the influence tables of a run; None if it has none.

    Example:
        >>> scex.exact_of(run) is None  # too few futures to check tables
        True
    """
    return read_exact(run.folder)


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
        draws = Draws(
            models=tuple(content["models"]),
            shares=np.array(content["shares"], dtype=np.float64),
            people=frozenset(content.get("people", ())),
            of_people=frozenset(content.get("of_people", ())),
        )
        tables = {}
        for entry in content["events"]:
            vehicles = [int(track) for track in entry["vehicles"]]
            cubes = [{int(track): int(level) for track, level in cut_set} for cut_set in entry["cut_sets"]]
            table = InfluenceTable.of_cubes(cubes, vehicles, draws, int(entry["checked"]))
            tables[entry["track_id"], entry["other_id"], entry["event"]] = table
        sampled = {(e["track_id"], e["other_id"], e["event"]): e["why"] for e in content["sampled"]}
        checked, extra = int(content["checked"]), int(content["extra"])
    except (OSError, ValueError, KeyError, TypeError, IndexError) as error:
        raise ResultError(f"{file}: cannot be read ({str(error)[:80]}); run again") from None
    return Exact(draws=draws, tables=tables, sampled=sampled, checked=checked, extra=extra)
