"""Verdict on a moment: test a pair, nothing to test, the models disagree, or the data are doubtful."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from scex_sumo.results.decision import DISAGREE, DOUBTFUL, NOTHING, TEST, VERDICTS, Decision
from scex_sumo.results.tables.pairs import NARROW, arrow, once_in, one_in
from scex_sumo.roads.places import PLACES

TEST_FROM: Final = 1e-4
"""P of a contact from which a pair is tested."""
PRINTED: Final = 1 / 1.05  # what is printed as once in 10 000 is tested
RARE: Final = 0.01
"""Share of the futures that collide above which P has to reach `TEST_FROM`; else the models disagree."""


def disagrees(row: Mapping[str, Any]) -> bool:
    """Whether more futures of a pair collide than its P says."""
    return bool(not is_to_be_tested(row) and row["collide"] > RARE)


def is_to_be_tested(row: Mapping[str, Any]) -> bool:
    """Whether a pair is tested, whatever its doubt."""
    return bool(row["probability"] >= PRINTED * TEST_FROM)


def decide(rows: Iterable[Mapping[str, Any]], *, futures: int) -> Decision:
    """Return the verdict on a moment.

    The most probable pair without doubt decides; where it is neither to be tested nor in dispute, one whose
    data are doubtful may.

    Args:
        rows: of ``pairs.parquet``, the most probable first.
        futures: number of human-like futures.
    """
    every = list(rows)
    sure = [row for row in every if not row["doubt"]]
    doubtful = [row for row in every if row["doubt"] and (is_to_be_tested(row) or disagrees(row))]
    tested = [row for row in sure if is_to_be_tested(row)]
    disputed = [row for row in sure if disagrees(row)]
    for kind, candidates in (
        (TEST, tested),
        (DISAGREE, disputed),
        (DOUBTFUL, doubtful),
        (NOTHING, sure),
        (DOUBTFUL, every),
    ):
        if candidates:
            row = candidates[0]
            same = ("what", "how", "place", "future", "probability", "least", "most", "doubt")
            return Decision(
                kind=kind,
                sentence=_sentence(kind, row, futures),
                pair=(row["track_id"], row["other_id"]),
                time_s=row["conflict_s"],
                **{name: row[name] for name in same},
            )
    return Decision(kind=NOTHING, sentence="Nothing to test: no two vehicles are near each other.")


def span(row: Mapping[str, Any]) -> str:
    """Return the range of P in words."""
    if row["least"] >= 0.995:
        return f"more than 99{NARROW}%"
    if row["probability"] >= 0.5:
        return f"{100 * row['least']:.0f} to {100 * row['most']:.0f}{NARROW}%"
    return f"{one_in(row['most'])} to {one_in(row['least'])}"


def _sentence(kind: str, row: Mapping[str, Any], futures: int) -> str:
    where = f"{row['what']}{' on the ring' if row['place'] == PLACES[0] else ''}"
    sentence = f"{arrow(row)} ({where}): {row['how'] or row['what']}"
    if kind == DISAGREE:
        sentence += f"; {round(row['collide'] * futures)} of {futures} human-like futures collide"
    if kind == DOUBTFUL:
        sentence = f"{arrow(row)}: {row['doubt']}"
    limit = f"to test from {one_in(TEST_FROM)} on"
    return (
        f"{VERDICTS[kind]}: {sentence}; people collide {once_in(row['probability'])} ({span(row)}; {limit})."
    )
