"""Verdicts, conditions and files of a test."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.suites.suite import Suite
from scex_sumo.suites.testing.outputs import junit_text, markdown_text, number_lines
from scex_sumo.suites.testing.result import (
    Condition,
    compared,
    number_of,
    read_result,
    unseen,
    with_verdicts,
)
from scex_sumo.suites.testing.tasks import chance


def record(name: str, contacts: int, people: float, futures: int = 48, **given: Any) -> dict[str, Any]:
    spread = np.full(futures, people / futures)
    return {
        "name": name,
        "kind": "merge",
        "action": "7 brakes",
        "contacts": contacts,
        "people_contacts": people,
        "futures": futures,
        "chance": chance(spread, spread, contacts),
        "probability": contacts / 1000,
        "people": people / 1000,
        "severity": contacts / 1e5,
        "most": 0.1,
        "variance": 0.0,
        "weight": 10.0,
        **given,
    }


FAILED = {
    "name": "d",
    "kind": "head-on",
    "action": "7 drifts",
    "weight": 10.0,
    "reason": "x: plan.x is not finite",
}
RECORDS = [record("a", 20, 2.0), record("b", 0, 20.0), record("c", 2, 2.0), FAILED]


def suite() -> Suite:
    cases = [
        {"name": name, "weight": 10.0, "stratum": k // 2, "severity": 1e-6} for k, name in enumerate("abcd")
    ]
    strata = [{"words": "one", "candidates": 20}, {"words": "two", "candidates": 20}]
    people = {"collisions_per_hour": 1e-3, "severe_per_hour": 1e-5}
    info = {
        "cases": cases,
        "strata": strata,
        "hours": 2.0,
        "people": people,
        "unseen": ["lane change"],
        "doubtful": 4,
    }
    return Suite(folder=Path("suite"), info=info)


def result() -> dict[str, Any]:
    rows = with_verdicts(RECORDS)
    verdicts = ("better", "equal", "worse", "failed")
    return {
        "function": "acc:Acc",
        "suite": "suite",
        "cases": rows,
        "verdicts": {name: sum(one["verdict"] == name for one in rows) for name in verdicts},
        "number": number_of(suite(), rows),
        "unseen": unseen(suite(), rows),
    }


def test_more_contacts_than_people_are_worse_fewer_better() -> None:
    assert [one["verdict"] for one in with_verdicts(RECORDS)] == ["worse", "better", "equal", "failed"]


def test_the_chance_of_a_count_is_poisson_binomial() -> None:
    found = chance(*[np.array([0.5, 0.25])] * 2, 1)
    assert found["more"] == pytest.approx(1 - 0.5 * 0.75)
    assert found["fewer"] == pytest.approx(1 - 0.5 * 0.25)


def test_weights_of_failed_cases_go_to_their_stratum() -> None:
    number = number_of(suite(), with_verdicts(RECORDS))
    assert number is not None
    assert number["collisions_per_hour"]["value"] == pytest.approx((10 * 0.02 + 0 + 20 * 0.002) / 2)
    assert number_of(suite(), with_verdicts([FAILED])) is None


def test_the_difference_is_to_people_in_the_whole_data_set_if_all_strata_ran() -> None:
    number, part = (number_of(suite(), with_verdicts(some)) for some in (RECORDS, RECORDS[:2]))
    assert number is not None and part is not None
    value = number["collisions_per_hour"]["value"]
    assert number["difference"]["value"] == pytest.approx(value - 1e-3)
    assert number["severe_difference"]["high"] == pytest.approx(number["severe_per_hour"]["high"] - 1e-5)
    people = 10 * (0.002 + 0.02) / 2  # of the stratum that ran
    assert part["difference"]["value"] == pytest.approx(part["collisions_per_hour"]["value"] - people)


def test_a_number_of_one_case_is_said_to_be_so() -> None:
    one = result()
    assert one["number"]["largest"] == {
        "name": "a",
        "share": pytest.approx(10 * 0.02 / (10 * 0.02 + 20 * 0.002)),
    }
    assert any("83% of the collisions are of one case, a, that" in line for line in number_lines(one))
    even = [record("a", 4, 2.0), record("b", 4, 2.0), record("c", 4, 2.0), record("d", 4, 2.0)]
    one["number"] = number_of(suite(), with_verdicts(even))
    assert not any("one case" in line for line in number_lines(one))


def test_what_is_not_seen_is_said() -> None:
    words = unseen(suite(), with_verdicts(RECORDS))
    assert words[0] == "lane change: no case"
    assert "4 encounters with doubtful data were left out" in words
    only = with_verdicts([RECORDS[0], RECORDS[1], FAILED])
    assert "two: no case has run (20 candidates)" in unseen(suite(), only)


@pytest.mark.parametrize(
    ("text", "holds"),
    [("worse > 0", True), ("failed>=2", False), ("better == 1", True), ("collisions_per_hour < 1e-3", False)],
)
def test_a_condition_is_a_name_an_operator_and_a_number(text: str, holds: bool) -> None:
    assert Condition.of(text).holds(result()) is holds


@pytest.mark.parametrize(
    "text", ["", "worse", "worst > 0", "worse > many", "worse > 1 and failed > 0", "worse > -"]
)
def test_a_bad_condition_is_one_line(text: str) -> None:
    with pytest.raises(UsageError, match="needs NAME OPERATOR NUMBER"):
        Condition.of(text)


def test_junit_has_a_failure_for_worse_and_an_error_for_failed() -> None:
    root = ET.fromstring(junit_text(result()).encode())
    (one,) = root
    assert {name: one.get(name) for name in ("tests", "failures", "errors")} == {
        "tests": "4",
        "failures": "1",
        "errors": "1",
    }
    kinds = {case.get("name"): case[0].tag for case in one}
    assert kinds == {"a": "failure", "b": "system-out", "c": "system-out", "d": "error"}


def test_the_summary_has_the_number_and_the_bad_cases() -> None:
    text = markdown_text(result())
    assert text.startswith("## acc:Acc on suite: 1 better, 1 equal, 1 worse, 1 failed\n")
    assert "| merge | 1 | 1 | 1 | 0 |" in text
    assert "- `d` x: plan.x is not finite" in text
    assert "collisions an hour: 0.12 [" in text


def test_against_says_what_changed() -> None:
    old = {**result(), "function": "old", "cases": [{**one, "verdict": "equal"} for one in result()["cases"]]}
    change = compared(result(), old)
    assert change["became_worse"] == ["a", "d"]
    assert change["became_better"] == ["b"]
    assert change["same"] == 1


def test_an_older_result_must_be_of_the_same_suite(tmp_path: Path) -> None:
    file = tmp_path / "old.json"
    file.write_text(json.dumps({**result(), "suite_digest": "1"}))
    assert read_result(file, "1")["function"] == "acc:Acc"
    with pytest.raises(ResultError, match="of another suite"):
        read_result(file, "2")
    file.write_text("[1]")
    with pytest.raises(ResultError, match="no result of a test"):
        read_result(file, "1")


def test_futures_that_may_go_either_way_are_no_evidence() -> None:
    """Of ten, people surely touch in five; in three of the others a tenth of a second decides."""
    most, least = np.repeat([1.0, 1.0, 0.0], [5, 3, 2]), np.repeat([1.0, 0.0, 0.0], [5, 3, 2])
    for contacts in (5, 6, 8):
        assert chance(most, least, contacts) == {"more": 1.0, "fewer": 1.0}
    assert chance(most, least, 9)["more"] == 0.0
    assert chance(most, least, 4)["fewer"] == 0.0
