"""Encounters of a run in both sets of futures: the stress test and the human-like reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from scex_sumo.drivers.registry import MIXES
from scex_sumo.metrics.events import EVENTS, MEASURED
from scex_sumo.reports.words import Head
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import (
    QUESTIONS,
    Encounter,
    criticality,
    event_of,
    in_words,
    precedence_words,
)
from scex_sumo.results.tables.pairs import arrow

STRESS_TEST: Final = "stress test"
HUMAN_LIKE: Final = "human-like"

_SHARE = "Share of the futures; a click on a row shows the typical one"
HEADS: Final[tuple[Head, ...]] = (
    ("pair", "names", "A vehicle hits or follows → another"),
    ("place", "names", ""),
    ("futures", "names", "Stress test: driven as the models of the run; human-like: as people were recorded"),
    (EVENTS["collision"].title, "percent", _SHARE),
    ("95 %", "text", "Interval of P(collision)"),
    *((event.title, "percent", f"{event.question}. {_SHARE}") for event in MEASURED),
    ("any", "percent", f"Any of these. {_SHARE}"),
    ("gap", "metres", "Least gap in the typical future; up to 10 m"),
    ("after", "seconds", "Time of the encounter in the typical future"),
    ("driven by", "words", "Models in the typical future"),
)
"""Columns of encounters in the terminal and on the page."""

_PAIRED = (("track_id", "other_id"), ("name", "other_name"), ("model", "other_model"))
_SWAP = {a: b for pair in _PAIRED for a, b in (pair, pair[::-1])}


@dataclass(frozen=True, kw_only=True, eq=False)
class Meeting(Encounter):
    """Encounter of two vehicles in one set of futures, of which its shares are.

    Of human-like futures ``stress`` is the pair in the stress test; None if it never meets there.
    """

    futures: str
    stress: Encounter | None = None

    @property
    def named_row(self) -> dict[str, Any]:
        """The row with the name of its set of futures."""
        return {"futures": self.futures, **self.row}

    @property
    def doubt(self) -> str | None:
        """Why the data of the pair are doubtful; None if they are not."""
        doubt = self.row["doubt"]
        return None if doubt is None else str(doubt)

    def words(self) -> str:
        """Return the encounter in words, with the futures in which its event always happened."""
        event = event_of(self.row)[0] or "critical"
        text = in_words(self.row) + precedence_words(self.run.info, self.pair)
        text += f"; doubtful: {self.doubt}" if self.doubt else ""
        if self.futures == STRESS_TEST:
            return text
        stress = None if self.stress is None else self.stress.probability(event)
        possible = stress.percent if stress and stress.value else "never"
        return f"{text}; human-like, of {self.run.futures} futures; in the stress test {possible}"


def meetings(run: Run) -> list[Meeting]:
    """Return the pairs of both sets, the most critical first; the lines of a pair stand together.

    A pair that meets in the stress test has a human-like line only if it is critical there. Both lines name
    the pair alike, as it is critical in the stress test, else as it is in the human-like futures.
    """
    possible = {frozenset((row["track_id"], row["other_id"])): row for row in run.encounters.to_pylist()}
    likely: list[Meeting] = []
    for row in run.reference.encounters.to_pylist() if run.reference is not None else ():
        pair = frozenset((row["track_id"], row["other_id"]))
        stress = possible.get(pair)
        if stress is not None and stress["critical"] > 0:
            row = named_as(stress, row)
        elif stress is not None and row["critical"] > 0:
            possible[pair] = stress = named_as(row, stress)
        if row["critical"] > 0 or stress is None:
            meets = None if stress is None else Encounter(row=stress, run=run)
            likely.append(Meeting(futures=HUMAN_LIKE, run=run.reference, row=row, stress=meets))
    both = [*(Meeting(futures=STRESS_TEST, run=run, row=row) for row in possible.values()), *likely]
    by_pair: dict[tuple[int, int], list[Meeting]] = {}
    for meeting in sorted(both, key=lambda meeting: criticality(meeting.row)):
        by_pair.setdefault(meeting.pair, []).append(meeting)
    return [meeting for of_pair in by_pair.values() for meeting in of_pair]


def encounter_cells(meeting: Meeting) -> list[Any]:
    """Return the cells of an encounter under `HEADS`; probabilities with their intervals."""
    row, (collision, *others) = meeting.row, [meeting.probability(name) for name in QUESTIONS]
    return [
        arrow(row),
        ", ".join(filter(None, (row["place"], "doubtful" if meeting.doubt else None))) or None,
        meeting.futures,
        collision,
        f"{collision.range} %",
        *others,
        row["gap"],
        round(row["time_s"], 1),
        f"{row['model']}, {row['other_model']}",
    ]


def named_as(lead: Mapping[str, Any], encounter: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of a pair with the order of its vehicles and the place of another row of the pair."""
    if encounter["track_id"] != lead["track_id"]:
        encounter = {name: encounter[_SWAP.get(name, name)] for name in encounter}
    return {**encounter, "place": lead["place"]}


def driven_as(run: Run) -> str:
    """Return how the vehicles of a set of futures are driven, in words."""
    drawn = [entry["model"] for entry in run.info.get("models", ()) if entry["weight"] > 0]
    if len(drawn) != 1:
        return "any of the models"
    return "people were recorded" if drawn[0] == MIXES.get("likely") else drawn[0]


def worst_stress(run: Run) -> list[Meeting]:
    """Return the worst encounters of the stress test, without vehicles whose baseline is compared."""
    tested = set() if run.baseline is None else {int(track) for track in run.info["under_test"]}
    return [
        meeting
        for meeting in meetings(run)
        if meeting.futures == STRESS_TEST
        and meeting.row["critical"] > 0
        and not (meeting.doubt or tested & set(meeting.pair))
    ]
