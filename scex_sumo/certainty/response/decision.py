"""Decision: one sentence that says which pair of a moment is to be tested, if any.

A pair is tested if people collide hard in it with P ≥ `HARD`, or with P ≥ `UNAVOIDED` where a careful and
competent driver does not always avoid it, or if the expected severe injuries reach `SEVERE`. So a pair that
such a driver always avoids, and in which people collide once in 10 000, is not tested. docs/response.md gives
the reasons.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

from scex_sumo.certainty.response.answer import MOTIONS, any_of, once_in
from scex_sumo.certainty.response.usual import USUAL, Population, usual_columns, usual_of
from scex_sumo.results.extras import DOUBTFUL, NOTHING, TEST, Decision

HARD: Final = 1e-4
"""P of a contact at 4 m/s or more from which a pair is tested."""
UNAVOIDED: Final = 1e-5
"""The same if a careful and competent driver does not always avoid it."""
SEVERE: Final = 1e-6
"""Expected severe injuries (MAIS 3+) from which a pair is tested."""


@dataclass(frozen=True, kw_only=True)
class PairResponse:
    """Critical responses of two vehicles together.

    Attributes:
        row: the most probable one.
        probability: 1 - Π (1 - P) over both orders and all actions; so ``probability_hard``.
        expected_mais3: their sum.
        preventable: whether all are.
        doubt: the first one; None without any.
    """

    row: Mapping[str, Any]
    probability: float
    probability_hard: float
    expected_mais3: float
    preventable: bool
    doubt: str | None

    @property
    def pair(self) -> tuple[int, int]:
        """Track ids of the responder, which hits or follows, and of the initiator."""
        return int(self.row["other_id"]), int(self.row["track_id"])

    @property
    def arrow(self) -> str:
        """The pair in words."""
        return f"{self.row['other_id']} → {self.row.get('person') or self.row['track_id']}"

    @property
    def has_doubtful_data(self) -> bool:
        """Whether the doubt is about the recording."""
        return self.doubt is not None and not self.doubt.startswith(MOTIONS)

    @property
    def is_to_be_tested(self) -> bool:
        """Whether it reaches one of the limits, whatever its doubt."""
        unavoided = not self.preventable and self.probability_hard >= UNAVOIDED
        return self.probability_hard >= HARD or self.expected_mais3 >= SEVERE or unavoided


def pair_responses(rows: Iterable[Mapping[str, Any]]) -> Sequence[PairResponse]:
    """Return the pairs of rows of ``response.parquet``.

    Those to be tested come first, the most expected severe injuries before others; then the most probable.
    """
    pairs: dict[frozenset[int], list[Mapping[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: -float(row["probability"])):
        pairs.setdefault(frozenset((row["track_id"], row["other_id"])), []).append(row)
    responses = [
        PairResponse(
            row=own[0],
            probability=any_of(row["probability"] for row in own),
            probability_hard=any_of(row["probability_hard"] for row in own),
            expected_mais3=sum(row["expected_mais3"] for row in own),
            preventable=all(row["preventable"] for row in own),
            doubt=next((row["doubt"] for row in own if row["doubt"]), None),
        )
        for own in pairs.values()
    ]
    return sorted(
        responses,
        key=lambda one: (-one.expected_mais3 if one.is_to_be_tested else 0.0, -one.probability),
    )


def with_usual(table: pa.Table, population: Population, location: str) -> pa.Table:
    """Return the critical responses of a moment with what is usual for each pair, see `USUAL`."""
    rows, site = table.to_pylist(), population.site_of(location)
    pairs = {frozenset(one.pair): one for one in pair_responses(rows)}
    each = (pairs[frozenset((row["other_id"], row["track_id"]))] for row in rows)
    usual = [population.usual(site, one.row["kind"], one.probability) for one in each]
    for name, values in usual_columns(usual).items():
        table = table.append_column(name, pa.array(values, USUAL[name]))
    return table


def decide(
    rows: Iterable[Mapping[str, Any]],
    *,
    keep_doubtful: bool = False,
    varied: Callable[[tuple[int, int]], Sequence[PairResponse]] = lambda pair: (),
) -> Decision:
    """Return what to test in a moment.

    Args:
        rows: of ``response.parquet``, of one moment; maybe `with_usual`.
        keep_doubtful: doubtful pairs count, too.
        varied: returns the pair that decides as it is with errors of its data, see `sensitivity.varied`.
    """
    responses = pair_responses(rows)
    worst = deciding(responses, keep_doubtful=keep_doubtful)
    if worst is None:
        never = "no pair collides as often as once in a billion such moments"
        return Decision(kind=NOTHING, sentence=f"Nothing to test: {never}.")
    kind = NOTHING
    if worst.is_to_be_tested:
        kind = TEST if keep_doubtful or worst.doubt is None else DOUBTFUL
    row, others = worst.row, [] if kind == DOUBTFUL else varied(worst.pair)
    chances = sorted(one.probability for one in others)
    return Decision(
        kind=kind,
        sentence=_sentence(kind, worst) + _depends(worst, others),
        pair=worst.pair,
        place=row["kind"],
        time_s=row["time_s"],
        probability=worst.probability,
        probability_hard=worst.probability_hard,
        expected_mais3=worst.expected_mais3,
        preventable=worst.preventable,
        doubt=worst.doubt,
        least=chances[0] if chances else None,
        most=chances[-1] if chances else None,
    )


def _depends(worst: PairResponse, others: Sequence[PairResponse]) -> str:
    """Return a sentence if errors of the data change what is to be tested; else nothing."""
    changed = [one.probability for one in others if one.is_to_be_tested != worst.is_to_be_tested]
    if not changed:
        return ""
    often = once_in(min(changed) if worst.is_to_be_tested else max(changed))
    now = "nothing to test" if worst.is_to_be_tested else "to be tested"
    return f" This depends on the data: {often}, {now}, if boxes are 0.3 m or headings 2° off."


def deciding(responses: Sequence[PairResponse], *, keep_doubtful: bool = False) -> PairResponse | None:
    """Return the pair that decides: the first to be tested without doubt, else with doubtful data, else the
    first without doubt."""
    sure = [response for response in responses if keep_doubtful or response.doubt is None]
    doubtful = [response for response in responses if response.has_doubtful_data]
    tested = (response for response in (*sure, *doubtful) if response.is_to_be_tested)
    return next(tested, sure[0] if sure else None)


def _sentence(kind: str, worst: PairResponse) -> str:
    if kind == DOUBTFUL:
        return f"Doubtful data: {worst.doubt} ({worst.arrow})."
    place = [word for word in (worst.row["kind"], f"{worst.row['time_s']:.1f} s") if word]
    often = once_in(worst.probability)
    usual = usual_of(worst.row)
    site = f"; usual {usual.what}: {once_in(usual.median)}" if usual else ""
    if kind == TEST:
        careful = "" if worst.preventable else ", and a careful driver cannot always avoid it"
        return f"Test {worst.arrow} ({', '.join(place)}): people collide here {often}{careful}{site}."
    hard = ", but hardly ever hard" if worst.probability >= HARD else ""
    careful = ", and a careful driver avoids it" if worst.preventable else ""
    return f"Nothing to test: people collide in the worst pair, {worst.arrow}, {often}{hard}{careful}{site}."
