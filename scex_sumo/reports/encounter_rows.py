"""Encounters of a run in both sets of futures: the stress test and the human-like reference."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from scex_sumo.behaviors.registry import mixes
from scex_sumo.metrics.events import EVENTS
from scex_sumo.results.encounters import ENCOUNTERS, criticality, event_of, in_words, percent_of
from scex_sumo.results.probability import Encounter, Probability, probability_of
from scex_sumo.results.run import Run

if TYPE_CHECKING:
    from scex_sumo.results.region import Region

STRESS_TEST: Final = "stress test"
HUMAN_LIKE: Final = "human-like"

_SWAP = {"track_id": "other_id", "other_id": "track_id", "model": "other_model", "other_model": "model"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Meeting:
    """Encounter of two vehicles in one set of futures; its shares are of that set.

    Attributes:
        run: of the set.
        row: of its ``encounters.parquet``.
        stress: of human-like futures, the pair's row in the stress test; None if it never meets there.
    """

    futures: str
    run: Run
    row: Mapping[str, Any]
    stress: Mapping[str, Any] | None = None

    @cached_property
    def encounter(self) -> Encounter:
        """The encounter, for its probabilities."""
        return Encounter(row=self.row, run=self.run)

    @property
    def pair(self) -> tuple[int, int]:
        """Track ids, ascending."""
        return self.encounter.pair

    def above(self) -> str:
        """Return the first event whose human-like share is above that of the stress test, beyond chance.

        In words; empty without one.
        """
        row = self.row
        for name, event in EVENTS.items() if self.futures == HUMAN_LIKE else ():
            stress = self.stress or dict.fromkeys((name, f"{name}_high"), 0.0)
            if surely_above(row[name], row[f"{name}_low"], stress[name], stress[f"{name}_high"]):
                one = f"{row['track_id']} → {row['other_id']} {event.words}"
                return f"{one} in {row[name]:.1%}, {stress[name]:.1%}"
        return ""

    def words(self) -> str:
        """Return the encounter in words, with the cut sets of its event where the run has an exact table."""
        event = event_of(self.row)[0] or "critical"
        text = in_words(self.row, self.encounter.probability(event).known)
        if self.futures == STRESS_TEST:
            return text
        possible = "never" if not (self.stress and self.stress[event]) else percent_of(self.stress, event)
        return f"{text}; human-like, of {self.run.futures} futures; in the stress test {possible}"


def surely_above(value: float, low: float, other: float, other_high: float) -> bool:
    """Return whether a share exceeds another one with 97.5 %, from a limit of each.

    Source: Newcombe 1998, hybrid score interval of a difference.
    """
    return bool(value - other > math.hypot(value - low, other_high - other))


def meetings(run: Run, region: Region | None = None) -> list[Meeting]:
    """Return the pairs of both sets in a region, the most critical first; the lines of a pair stand together.

    A pair that meets in the stress test has a human-like line only if it is critical there. Both lines name
    the pair alike, as it is critical in the stress test, else as it is in the human-like futures.
    """
    if not (run.folder / ENCOUNTERS).is_file():
        return []
    possible = {frozenset((row["track_id"], row["other_id"])): row for row in run.encounters.to_pylist()}
    found, human = [], run.reference
    for row in [] if human is None else human.encounters.to_pylist():
        assert human is not None
        pair = frozenset((row["track_id"], row["other_id"]))
        stress = possible.get(pair)
        if stress is not None and stress["critical"] > 0:
            row = named_as(stress, row)
        elif stress is not None and row["critical"] > 0:
            possible[pair] = stress = named_as(row, stress)
        if row["critical"] > 0 or stress is None:
            found.append(Meeting(futures=HUMAN_LIKE, run=human, row=row, stress=stress))
    found = [Meeting(futures=STRESS_TEST, run=run, row=row) for row in possible.values()] + found
    indices = None if region is None else region.vehicles(run.scene)
    if indices is not None:
        inside = set(run.scene.track_ids[list(indices)].tolist())
        found = [one for one in found if set(one.pair) & inside]
    found.sort(key=lambda one: criticality(one.row))
    first: dict[tuple[int, int], int] = {}
    for number, one in enumerate(found):
        first.setdefault(one.pair, number)
    return sorted(found, key=lambda one: first[one.pair])


def named_as(lead: Mapping[str, Any], row: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a row of a pair with the order of its vehicles and the place of another row of the pair."""
    if row["track_id"] != lead["track_id"]:
        models = [{name: by[_SWAP.get(name, name)] for name in by} for by in row["models"]]
        row = {name: row[_SWAP.get(name, name)] for name in row} | {"models": models}
    return {**row, "place": lead["place"]}


def probability_in(run: Run, pair: tuple[int, int], event: str) -> Probability:
    """Return the probability of an event of a pair in a set of futures, in which it need not meet."""
    rows = run.encounters.to_pylist()
    found = next((row for row in rows if {row["track_id"], row["other_id"]} == set(pair)), None)
    if found is not None:
        return Encounter(row=found, run=run).probability(event)
    return probability_of(run, run.intervals.share(np.zeros(run.futures, dtype=np.bool_)), event, pair)


def driven_as(run: Run) -> str:
    """Return how the vehicles of a set of futures are driven, in words."""
    drawn = [entry["model"] for entry in run.info.get("models", ()) if entry["weight"] > 0]
    if len(drawn) != 1:
        return "any of the models"
    return "people were recorded" if drawn[0] == mixes().get("likely") else drawn[0]


def worst_of(found: list[Meeting], most: int, *, without: Collection[int] = ()) -> list[Meeting]:
    """Return the most critical line of each of the first pairs that are critical in some future.

    Args:
        without: leave out the pairs of these vehicles.
    """
    worst: dict[tuple[int, int], Meeting] = {}
    for one in found:
        if one.row["critical"] > 0 and not set(one.pair) & set(without):
            worst.setdefault(one.pair, one)
    return list(worst.values())[:most]
