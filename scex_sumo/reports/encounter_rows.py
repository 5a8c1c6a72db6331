"""Encounters of a run in both sets of futures: the stress test and the human-like reference."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

from scex_sumo.results.encounters import ENCOUNTERS, criticality, event_of, in_words, percent_of
from scex_sumo.results.probability import Encounter
from scex_sumo.results.region import EVERYWHERE, Region
from scex_sumo.results.run import Run

STRESS_TEST: Final = "stress test"
HUMAN_LIKE: Final = "human-like"


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
        """Return a human-like share above that of the stress test, beyond chance, in words; else nothing."""
        (event, words), row = event_of(self.row), self.row
        stress = self.stress or dict.fromkeys((event, f"{event}_high"), 0.0)
        if self.futures == STRESS_TEST or not event:
            return ""
        surely = surely_above(row[event], row[f"{event}_low"], stress[event], stress[f"{event}_high"])
        one = f"{row['track_id']} → {row['other_id']} {words}"
        return f"{one} in {row[event]:.1%}, {stress[event]:.1%}" if surely else ""

    def words(self) -> str:
        """Return the encounter in words, with its cut sets where the run has an exact table."""
        text = in_words(self.row, self.encounter.collision.known)
        event = event_of(self.row)[0] or "critical"
        if self.futures == STRESS_TEST:
            return text
        possible = "never" if not (self.stress and self.stress[event]) else percent_of(self.stress, event)
        return f"{text}; human-like, of {self.run.children} futures; in the stress test {possible}"


def surely_above(value: float, low: float, other: float, other_high: float) -> bool:
    """Return whether a share exceeds another one with 97.5 %, from a limit of each.

    Source: Newcombe 1998, hybrid score interval of a difference.
    """
    return bool(value - other > math.hypot(value - low, other_high - other))


def meetings(run: Run, region: Region = EVERYWHERE) -> list[Meeting]:
    """Return the pairs of both sets in a region, the most critical first; the lines of a pair stand together.

    A pair that meets in the stress test has a human-like line only if it is critical there.
    """
    if not (run.folder / ENCOUNTERS).is_file():
        return []
    found = [Meeting(futures=STRESS_TEST, run=run, row=row) for row in run.encounters.to_pylist()]
    possible = {one.pair: one.row for one in found}
    human = run.reference
    for row in [] if human is None else human.encounters.to_pylist():
        assert human is not None
        one = Meeting(futures=HUMAN_LIKE, run=human, row=row)
        stress = possible.get(one.pair)
        if row["critical"] > 0 or stress is None:
            found.append(Meeting(futures=HUMAN_LIKE, run=human, row=row, stress=stress))
    indices = None if region == EVERYWHERE else region.vehicles(run.scene)
    if indices is not None:
        inside = set(run.scene.track_ids[list(indices)].tolist())
        found = [one for one in found if set(one.pair) & inside]
    found.sort(key=lambda one: criticality(one.row))
    first: dict[tuple[int, int], int] = {}
    for number, one in enumerate(found):
        first.setdefault(one.pair, number)
    return sorted(found, key=lambda one: first[one.pair])


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
