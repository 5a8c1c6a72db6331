"""Critical responses in words: pairs of which the same can be said have one line."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from scex_sumo.certainty.response.answer import TOLD, once_in, rounded
from scex_sumo.certainty.response.decision import PairResponse
from scex_sumo.certainty.response.motion.actions import ACTIONS, BRAKES
from scex_sumo.results.tables.encounters import arrows, is_queue

_ALIKE = 10.0  # ratio of P within which pairs are told together
_MOST, _NEARLY = 0.6, 0.9


def grouped(responses: Iterable[PairResponse]) -> list[list[PairResponse]]:
    """Return pairs with P ≥ `TOLD` in groups of which the same can be said.

    They have the same action, all or none have time to respond, a careful driver avoids all or none, and P is
    within a factor of 10.
    """
    groups: list[list[PairResponse]] = []
    for response in responses:
        if response.probability < TOLD:
            continue
        for group in groups:
            if _kind(group[0]) == _kind(response) and group[0].probability < _ALIKE * response.probability:
                group.append(response)
                break
        else:
            groups.append([response])
    return groups


def _kind(response: PairResponse) -> tuple[Any, ...]:
    return (
        response.row["action"],
        response.row.get("person"),
        math.isfinite(response.row["response_s"]),
        response.preventable,
    )


def sentence(group: Sequence[PairResponse]) -> str:
    """Return what it takes until the vehicles of pairs collide, in one line."""
    rows, pairs = [response.row for response in group], [response.pair for response in group]
    queue = " of a queue" if rows[0]["action"] == ACTIONS[BRAKES].name and is_queue(pairs) else ""
    head = f"{len(group)} pairs{queue}, {arrows(pairs)}: " if len(group) > 1 else ""
    often = _span(
        group, lambda response: -response.probability, lambda response: once_in(response.probability)
    )
    factor = rounded(max(row["factor"] for row in rows))
    careful = "avoids it" if group[0].preventable else "does not always avoid it"
    return (
        f"{head}{takes(rows)}: a collision about {often} (a factor of {factor} either way); "
        f"a careful and competent driver (UN R157) {careful}"
    )


def takes(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return what it takes until two vehicles collide, by rows of the table with one action."""
    row = rows[0]
    (action,) = (kind for kind in ACTIONS if kind.name == row["action"])
    follows = action is ACTIONS[BRAKES]
    one, other = ("the leader", "the follower") if follows else ("one", "the other")
    if len(rows) == 1:
        one, other = str(row.get("person") or row["track_id"]), str(row["other_id"])
    value = _span(rows, lambda row: row["value"], lambda row: f"{row['value']:g}")
    does = action.words.format(value) if value != "0" else action.words.partition(",")[0]
    often = _span(rows, lambda row: -row["frequency"], lambda row: once_in(row["frequency"]))
    return f"{one} {does} ({often}) and {other} {_late(rows)}"


def needs(row: Mapping[str, Any]) -> str:
    """Return what the responder needs against the action that is told; nothing without contact."""
    braking, swerve, left = (row.get(name) for name in ("needed_braking", "needed_swerve", "time_to_react"))
    if braking == swerve == math.inf:
        return "neither braking nor a swerve helps"
    helps = {name: value for name, value in (("braking", braking), ("swerve", swerve)) if value is not None}
    words = [
        f"needed {name} {value:.1f} m/s²" if math.isfinite(value) else f"no {name} helps"
        for name, value in helps.items()
    ]
    late = "too late to react" if left == -math.inf else f"{left or 0:.1f} s left to react"
    return ", ".join([*words, *([] if left is None else [late])])


def _late(rows: Sequence[Mapping[str, Any]]) -> str:
    if not math.isfinite(rows[0]["response_s"]):
        return "cannot brake in time" if rows[0]["later"] > _NEARLY else "can hardly brake in time"
    late = _span(rows, lambda row: row["response_s"], lambda row: f"{row['response_s']:.1f}")
    share = _span(rows, lambda row: -row["later"], lambda row: _share(row["later"]))
    return f"responds later than {late} s ({share})"


def _share(later: float) -> str:
    return f"one of {rounded(1 / later)}" if later < _MOST else "as most do"


def _span(ones: Sequence[Any], number: Callable[[Any], float], words: Callable[[Any], str]) -> str:
    """Return the words of the one with the least number, and of the one with the largest."""
    low, high = words(min(ones, key=number)), words(max(ones, key=number))
    begin = "once in " if low.startswith("once in ") else "one of " if low.startswith("one of ") else ""
    return low if low == high else f"{low} to {high.removeprefix(begin)}"
