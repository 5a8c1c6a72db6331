"""Verdicts, conditions and files of a test."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.suites.suite import Suite
from scex_sumo.suites.testing.result import (
    VERDICTS,
    compared,
    holding,
    junit_text,
    markdown_text,
    number_lines,
    number_of,
    read_condition,
    read_result,
    unseen,
    with_verdicts,
)


def record(name: str, probability: float, people: float, p: float | None = 1e-6) -> dict[str, Any]:
    return {
        "name": name,
        "kind": "merge" if name < "c" else "head-on",
        "probability": probability,
        "people": people,
        "pair": probability,
        "people_pair": people,
        "variance": 1e-12,
        "people_variance": 1e-12,
        "difference_variance": 1e-12,
        "p_alone": p,
        "futures": 64,
        "collide": 0.25,
        "people_collide": 0.0,
    }


FAILED = {"name": "d", "kind": "head-on", "reason": "x: plan.x is not finite"}
RECORDS = [record("a", 2e-2, 1e-4), record("b", 1e-6, 2e-3), record("c", 2e-3, 1e-3, 0.5), FAILED]


def suite(weight: float = 10.0) -> Suite:
    cases = [
        {"name": name, "weight": weight, "chance": 0.1, "stratum": k // 2} for k, name in enumerate("abcd")
    ]
    exposure = [
        {"kind": kind, "encounters": 20.0, "people_collide_per_hour": 5e-4}
        for kind in ("merge", "head-on", "lane change")
    ]
    people = {"collisions_per_hour": 1e-3}
    info = {"cases": cases, "hours": 2.0, "people": people, "exposure": exposure}
    return Suite(folder=Path("suite"), info=info | {"rare": 9, "doubtful": 4})


def result(records: list[dict[str, Any]] = RECORDS, **given: Any) -> dict[str, Any]:
    rows = with_verdicts(records)
    return {
        "function": "acc:Acc",
        "suite": "suite",
        "cases": rows,
        "verdicts": {name: sum(one["verdict"] == name for one in rows) for name in VERDICTS},
        "number": number_of(suite(), rows),
        "unseen": unseen(suite(), rows),
        **given,
    }


def verdict(probability: float, people: float, p: float | None = 1e-6) -> str:
    return str(with_verdicts([record("a", probability, people, p)])[0]["verdict"])


def test_more_than_people_is_worse_less_is_better_and_chance_is_neither() -> None:
    assert [one["verdict"] for one in with_verdicts(RECORDS)] == ["worse", "better", "equal", "failed"]


def test_what_nobody_would_test_and_small_differences_are_equal() -> None:
    assert verdict(9e-5, 1e-7) == "equal"  # both below once in 10 000
    assert verdict(1.9e-3, 1e-3) == "equal"  # less than twice
    assert verdict(2.1e-3, 1e-3) == "worse"
    assert verdict(1e-3, 1e-3, None) == "equal"  # the same in all futures


def test_weights_of_failed_cases_go_to_their_kind() -> None:
    number = number_of(suite(), with_verdicts(RECORDS))
    assert number is not None
    assert number["collisions_per_hour"]["value"] == pytest.approx((10 * 0.020001 + 20 * 0.002) / 2)
    assert number_of(suite(), with_verdicts([FAILED])) is None


def test_the_difference_to_people_is_paired() -> None:
    number = result()["number"]
    people = (10 * (1e-4 + 2e-3) + 20 * 1e-3) / 2
    assert number["people_collisions_per_hour"]["value"] == pytest.approx(people)
    own = number["collisions_per_hour"]["value"]
    assert number["difference"]["value"] == pytest.approx(own - people)
    alike = [record(name, 1e-3, 1e-3, None) | {"difference_variance": 0.0} for name in "abcd"]
    same = number_of(suite(), with_verdicts(alike))
    assert same is not None
    assert (same["difference"]["low"], same["difference"]["high"]) == (0.0, 0.0)


def test_a_wide_interval_says_how_many_cases_a_narrow_one_needs() -> None:
    wide = number_lines(result())[-1]
    assert wide.startswith("an interval of a factor of 3 needs about ") and wide.endswith(" cases")
    even = [record(name, 1e-3, 1e-3, None) for name in "abcd"]
    assert len(number_lines(result(even))) == 2


def test_what_is_not_seen_is_said() -> None:
    words = unseen(suite(), with_verdicts(RECORDS))
    assert words[0] == "lane change: no case has run (20 encounters)"
    assert words[1].startswith("9 encounters in which people collide less than once in a million")
    assert "4 encounters with doubtful data" in words
    only = with_verdicts([RECORDS[0], RECORDS[1], FAILED])
    assert "head-on: no case has run (20 encounters)" in unseen(suite(), only)


@pytest.mark.parametrize(
    ("text", "holds"),
    [("worse > 0", True), ("failed>=2", False), ("better == 1", True), ("collisions_per_hour < 1e-3", False)],
)
def test_a_condition_is_a_name_an_operator_and_a_number(text: str, holds: bool) -> None:
    assert (holding(read_condition(text), result()) is not None) is holds


@pytest.mark.parametrize(
    "text", ["", "worse", "worst > 0", "worse > many", "worse > 1 and failed > 0", "worse > -"]
)
def test_a_bad_condition_is_one_line(text: str) -> None:
    with pytest.raises(UsageError, match="needs NAME OPERATOR NUMBER"):
        read_condition(text)


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
    assert "- collisions an hour: 0.12 [" in text
    assert "- d: x: plan.x is not finite" in text
    assert (
        "- a: worse: collides about once in 50 such moments, people about once in 10\u202f000 such moments"
        in text
    )


def test_against_says_what_changed_and_the_paired_difference() -> None:
    old = result(function="old")
    old["cases"] = [{**one, "verdict": "equal"} for one in old["cases"]]
    change = compared(suite(), result(), old)
    assert change["became_worse"] == ["a", "d"]
    assert change["became_better"] == ["b"]
    assert (change["difference"]["value"], change["difference"]["high"]) == (0.0, 0.0)
    more = result([{**one, "pair": one["pair"] + 1e-3} for one in RECORDS[:3]])
    assert compared(suite(), more, old)["difference"]["value"] == pytest.approx((2 * 10 + 20) * 1e-3 / 2)
    assert (
        "against old: 1 became better, 2 became worse; difference, collisions an hour: 0 [0, 0]"
        in markdown_text(result(against=change))
    )


def test_an_older_result_must_be_of_the_same_suite(tmp_path: Path) -> None:
    file = tmp_path / "old.json"
    file.write_text(json.dumps({**result(), "suite_digest": "1"}))
    assert read_result(file, "1")["function"] == "acc:Acc"
    with pytest.raises(ResultError, match="of another suite"):
        read_result(file, "2")
    for wrong, says in (
        ([1], "needs object"),
        (result() | {"cases": [{"name": 1}]}, r"cases\[0\].name is 1"),
        (
            result() | {"cases": [{"name": "a", "verdict": "worse", "pair": 2}]},
            r"cases\[0\].pair is 2, needs at most 1",
        ),
    ):
        file.write_text(json.dumps(wrong))
        with pytest.raises(ResultError, match=f"{says}.*give --against the test.json of a test"):
            read_result(file, "1")
