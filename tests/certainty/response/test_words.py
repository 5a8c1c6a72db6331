"""Critical responses in words, one line for pairs that say the same."""

from __future__ import annotations

import math
from typing import Any

from scex_sumo.certainty.response.answer import once_in
from scex_sumo.certainty.response.decision import pair_responses
from scex_sumo.certainty.response.words import grouped, needs, sentence

ROW = {
    "track_id": 15, "other_id": 16, "action": "brakes", "value": 5.0, "frequency": 1 / 700, "response_s": 1.1,
    "later": 1 / 9, "probability": 1 / 6300, "probability_hard": 1e-5, "expected_mais3": 1e-8, "factor": 4.2,
    "preventable": True, "doubt": None, "kind": "lane", "time_s": 2.0,
}  # fmt: skip


def lines(*rows: dict[str, Any]) -> list[str]:
    return [sentence(group) for group in grouped(pair_responses([{**ROW, **row} for row in rows]))]


def test_words_have_one_digit() -> None:
    assert once_in(1 / 41234) == "once in 40 000"
    assert once_in(0.0149) == "once in 70"
    assert lines({}) == [
        "15 brakes with 5 m/s² or more (once in 700) and 16 responds later than 1.1 s (one of 9): "
        "a collision about once in 6 000 (a factor of 4 either way); "
        "a careful and competent driver (UN R157) avoids it"
    ]
    assert "16 can hardly brake in time" in lines({"response_s": -math.inf, "later": 0.5})[0]
    assert "16 cannot brake in time" in lines({"response_s": -math.inf, "later": 1.0})[0]
    assert "later than 0.4 s (as most do)" in lines({"response_s": 0.4, "later": 0.8})[0]


def test_the_pairs_of_a_queue_have_one_line() -> None:
    second = {"track_id": 16, "other_id": 17, "response_s": 1.4, "later": 1 / 20, "probability": 1 / 12000}
    (line,) = lines({}, second)
    assert line == (
        "2 pairs of a queue, 16 → 15, 17 → 16: the leader brakes with 5 m/s² or more (once in 700) and the "
        "follower responds later than 1.1 to 1.4 s (one of 9 to 20): a collision about once in 6 000 to "
        "10 000 (a factor of 4 either way); a careful and competent driver (UN R157) avoids it"
    )
    assert lines({}, second | {"track_id": 18})[0].startswith("2 pairs, 16 → 15, 17 → 18: ")


def test_what_differs_or_is_much_rarer_has_a_line_of_its_own() -> None:
    for other in ({"preventable": False}, {"action": "cuts in"}, {"probability": 1 / 70000}):
        assert len(lines({}, {"track_id": 16, "other_id": 17, **other})) == 2
    assert lines({"probability": 0.9e-7}) == []


def test_what_a_responder_needs_is_told_where_it_is_known() -> None:
    row = {"needed_braking": 4.12, "needed_swerve": math.inf, "time_to_react": 0.58}
    assert needs(row) == "needed braking 4.1 m/s², no swerve helps, 0.6 s left to react"
    late = {"needed_braking": math.inf, "time_to_react": -math.inf}
    assert needs(late) == "no braking helps, too late to react"
    assert needs(late | {"needed_swerve": math.inf}) == "neither braking nor a swerve helps"
    assert needs(dict.fromkeys(row)) == ""
