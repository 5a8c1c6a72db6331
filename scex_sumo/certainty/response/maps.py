"""Maps of critical responses: the numbers from which a page integrates P again, with other people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.certainty.response.critical import CAREFUL_S, DECELERATIONS, JERK_MPS3, by_action
from scex_sumo.certainty.response.motion.actions import ACTIONS, BRAKES, GRAZE_M, LEVELS, TIME_S, Cases
from scex_sumo.certainty.response.people import (
    CLOSEST,
    DRAWS,
    REFERENCE_GAP_S,
    People,
    left_at,
    time_gaps,
)

MAPPED: Final = 8
"""Most rows of ``response.parquet`` with a map."""
_NAMES = ("track_id", "other_id", "action", "value", "probability", "doubt")
_DIGITS = 6  # of a number: P to 1e-5
_EVERY = 2  # steps between the poses that a page gets
_LINE_POINTS = 41
_MOTION = 100  # motion in whole cm and hundredths of rad


def maps_of(
    people: People,
    cases: Cases,
    response_s: FloatArray,
    often: FloatArray,
    told: Mapping[int, Mapping[str, Any]],
) -> dict[str, Any]:
    """Return the maps of some rows, and the people, for JSON.

    Args:
        cases: ten for each row of the table.
        response_s: (m, A) R* of the cases, s.
        often: (n, 10) frequency of at least each value.
        told: rows that get a map, by number.

    Returns:
        ``people``: what `People.later` needs, and the actions. ``pairs``: names and P of the row; time
        ``gap`` in s, null: not ahead; ``often`` by value; ``responses`` (R*, null: no contact, -1: at once)
        and ``left`` by value and deceleration; and what a page needs to play it, see `_motions`.
    """
    rows = np.fromiter(told, dtype=np.int64, count=len(told))
    at = (rows[:, None] * LEVELS + np.arange(LEVELS)).ravel()
    some, critical = cases.take(at), response_s[at]
    gaps, left = time_gaps(some)[::LEVELS], left_at(some, critical)
    shape = (len(rows), LEVELS, len(DECELERATIONS))
    pairs = [
        {
            **{name: row[name] for name in _NAMES},
            "gap": None if np.isinf(gap) else _rounded(gap),
            "often": _listed(frequency),
            "responses": [[_response(r) for r in line] for line in responses],
            "left": [_listed(line) for line in share],
            **motion,
        }
        for row, gap, frequency, responses, share, motion in zip(
            told.values(),
            gaps,
            often[rows],
            critical.reshape(shape),
            left.reshape(shape),
            _motions(some),
            strict=True,
        )
    ]
    return {"people": _people(people), "pairs": pairs}


def _motions(cases: Cases) -> Iterator[dict[str, Any]]:
    """Yield for each row the motion of both, all in equal steps.

    ``acts`` by value: x, y in cm and heading in hundredths of rad of the initiator; ``onset`` by value: when
    the action shows, s; ``way``: expected way of the responder, m; ``line``: x, y and heading of it as above,
    along its line until ``reach``, m.
    """
    outlines, expected = cases.outlines, cases.pairs.expected
    poses = np.stack([outlines.x, outlines.y, outlines.heading], axis=-1)[:, ::_EVERY]
    acts = by_action(np.rint(poses * _MOTION).astype(np.int64))
    for row, onset in enumerate(by_action(cases.onset_s)):
        j = cases.pairs.responder[cases.pair[row * LEVELS, None]]
        way = expected.s[j[0], ::_EVERY]
        reach = max(float(way[-1]), 1.0)
        line = np.stack(expected.lines.at(j, np.linspace(0.0, reach, _LINE_POINTS)[None]), axis=-1)[0]
        yield {
            "acts": acts[row].tolist(),
            "onset": [None if np.isinf(time) else _rounded(time) for time in onset],
            "way": way.round(3).tolist(),
            "line": np.rint(line * _MOTION).astype(np.int64).tolist(),
            "reach": reach,
        }


def _people(people: People) -> dict[str, Any]:
    names = ("response_spread", "away_share", "glance_s", "glance_spread")
    return {
        **{name: getattr(people, name) for name in (*names, "close_response", "close_away", "growth")},
        "response_s": people.response_s.tolist(),
        "shares": people.decelerations.tolist(),
        "decelerations": DECELERATIONS,
        "reference_gap_s": REFERENCE_GAP_S,
        "closest": CLOSEST,
        "draws": DRAWS,
        "step_s": float(TIME_S[1]),
        "last_s": float(TIME_S[-1]),
        "careful_s": CAREFUL_S,
        "jerk_mps3": JERK_MPS3,
        "graze_m": GRAZE_M,
        "actions": [
            {"name": a.name, "unit": a.unit, "values": a.values, "words": a.words, "smooth": kind == BRAKES}
            for kind, a in enumerate(ACTIONS)
        ],
    }


def _listed(values: FloatArray) -> Sequence[float]:
    return [_rounded(value) for value in values]


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _response(value: float) -> float | None:
    return -1.0 if value == -np.inf else None if value == np.inf else round(float(value), 3)
