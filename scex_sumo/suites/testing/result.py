"""Result of a test: verdicts of the cases, the number, what changed; as JUnit XML, Markdown, and a page."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

import numpy as np

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.schema import SHARE, TEXT, listed, read_json, record
from scex_sumo.decision.decide import TEST_FROM
from scex_sumo.page.columns import Column
from scex_sumo.page.document import card
from scex_sumo.page.html import element
from scex_sumo.reports.under_test import chance_text
from scex_sumo.results.tables.pairs import once_in, rounded
from scex_sumo.statistics.paired import holm
from scex_sumo.suites.estimate import NARROW, Design, Rate
from scex_sumo.suites.page import CaseCard, stands_for, write_case_page
from scex_sumo.suites.suite import Suite

BETTER, EQUAL, WORSE, FAILED = VERDICTS = ("better", "equal", "worse", "failed")
CHANCE: Final = 0.05
CHANGES: Final = ("became_better", "became_worse")
RATES: Final = ("collisions_per_hour", "difference")
MATTERS: Final = 2.0
"""Factor by which P has to differ from people's; so small a difference matters to nobody."""
_OPERATORS: Final[dict[str, Callable[[float, float], bool]]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    ">": operator.gt,
    "<": operator.lt,
}
_CONDITION = re.compile(r"\s*([a-z_]+)\s*(>=|<=|==|>|<)\s*([-+.\deE]+)\s*")


def read_condition(text: str) -> tuple[str, str, float]:
    """Return name, operator and number of a condition as ``worse > 0``.

    Raises:
        UsageError: it is none, or names something else.
    """
    match = _CONDITION.fullmatch(text)
    try:
        if match is None or match[1] not in (*VERDICTS, *RATES):
            raise ValueError
        return match[1], match[2], float(match[3])
    except ValueError:
        known = ", ".join((*VERDICTS, *RATES))
        raise UsageError(
            f"--fail-if {text!r}: needs NAME OPERATOR NUMBER, e.g. 'worse > 0'; names: {known}"
        ) from None


def holding(condition: tuple[str, str, float], result: Mapping[str, Any]) -> str | None:
    """Return a condition in words if a result fulfils it; the rate of no case is infinite."""
    name, sign, limit = condition
    number = result["number"]
    if name in VERDICTS:
        value = float(result["verdicts"][name])
    else:
        value = float("inf") if number is None else float(number[name]["value"])
    return f"{name} {sign} {limit:g} (it is {value:g})" if _OPERATORS[sign](value, limit) else None


def with_verdicts(records: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return records of cases with verdict and p, after Holm.

    A case is worse, or better, if P differs from people's by a factor of `MATTERS` and not by chance, and one
    of both is large enough to be tested.
    """
    alone = [case.get("p_alone") for case in records]
    corrected = holm([float("nan") if p is None else p for p in alone])
    judged = []
    for case, p in zip(records, corrected, strict=True):
        if "reason" in case:
            judged.append({**case, "verdict": FAILED})
            continue
        less, more = sorted((case["probability"], case["people"]))
        differs = p < CHANCE and more >= TEST_FROM and more >= MATTERS * less
        changed = WORSE if case["probability"] > case["people"] else BETTER
        judged.append({**case, "verdict": changed if differs else EQUAL, "p": None if np.isnan(p) else p})
    return judged


def number_of(suite: Suite, records: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return the rates of the function and of people, and their difference; None if every case failed.

    Contacts with the other one of each case count: those with third vehicles belong to other encounters. The
    weights of failed cases go to the others of their kind; a kind without any other is not seen.
    """
    cases, design = _of_suite(suite, records)
    if not cases:
        return None
    names = ("pair", "people_pair", "variance", "people_variance", "difference_variance")
    y, people, drawn, drawn_people, apart = (np.array([case[name] for case in cases]) for name in names)
    return {
        "collisions_per_hour": asdict(design.rate(y, drawn)),
        "people_collisions_per_hour": asdict(design.rate(people, drawn_people)),
        "people_of_all": suite.info["people"],
        "difference": asdict(design.difference(y - people, apart)),
        "cases": len(cases),
    }


def _of_suite(suite: Suite, records: Sequence[Mapping[str, Any]]) -> tuple[list[Mapping[str, Any]], Design]:
    """Return the records of the cases that ran, in the order of the suite, and their design."""
    by_name = {case["name"]: case for case in records if "probability" in case}
    ran = np.array([case.name in by_name for case in suite.cases])
    return [by_name[case.name] for case in suite.cases if case.name in by_name], suite.design.part(ran)


def unseen(suite: Suite, records: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the suite cannot see, one sentence each."""
    ran = {case["kind"] for case in records if "reason" not in case}
    exposure = {of_kind["kind"]: of_kind["encounters"] for of_kind in suite.info["exposure"]}
    words = [f"{kind}: no case has run ({n:g} encounters)" for kind, n in exposure.items() if kind not in ran]
    return [
        *words,
        f"{suite.info['rare']} encounters in which people collide less than once in a million moments",
        f"{suite.info['doubtful']} encounters with doubtful data",
        "pairs that the data set does not have; offences at lights; weather, sensors; what comes after 3 s",
    ]


def compared(suite: Suite, result: Mapping[str, Any], old: Mapping[str, Any]) -> dict[str, Any]:
    """Return which cases became better, worse or failed since an older result, and the paired difference."""
    rank = {BETTER: 0, EQUAL: 1, WORSE: 2, FAILED: 3}
    before = {case["name"]: case for case in old["cases"]}
    now = {case["name"]: case for case in result["cases"] if case["name"] in before}
    change = {name: rank[case["verdict"]] - rank[before[name]["verdict"]] for name, case in now.items()}
    ran_before = [case for case in now.values() if {"pair", "variance"} <= {*before[case["name"]]}]
    cases, design = _of_suite(suite, ran_before)
    more = np.array([case["pair"] - before[case["name"]]["pair"] for case in cases])
    drawn = np.array([case["variance"] + before[case["name"]]["variance"] for case in cases])
    return {
        "function": old["function"],
        CHANGES[0]: [name for name, by in change.items() if by < 0],
        CHANGES[1]: [name for name, by in change.items() if by > 0],
        "difference": asdict(design.difference(more, np.where(more == 0, 0.0, drawn))) if cases else None,
    }


_CASE = record(
    {"name": TEXT, "verdict": {"enum": list(VERDICTS)}},
    {"pair": SHARE, "variance": {"type": "number", "minimum": 0}},
)
_RESULT: Final = record({"function": TEXT, "suite_digest": TEXT, "cases": listed(_CASE)})


def read_result(file: Path, suite: str) -> dict[str, Any]:
    """Read an older result; raise a `ResultError` if it cannot be read, or is of another suite."""
    content: dict[str, Any] = read_json(file, _RESULT, "give --against the test.json of a test")
    if content["suite_digest"] != suite:
        raise ResultError(f"--against {file}: of another suite; test both functions on the same one")
    return content


def junit_text(result: Mapping[str, Any]) -> str:
    """Return the cases as JUnit XML: worse ones are failures, failed ones errors."""
    cases, counts = result["cases"], result["verdicts"]
    root = ET.Element("testsuites")
    suite = ET.SubElement(
        root,
        "testsuite",
        name=str(result["suite"]),
        tests=str(len(cases)),
        failures=str(counts[WORSE]),
        errors=str(counts[FAILED]),
        time=f"{sum(case.get('seconds', 0.0) for case in cases):.2f}",
    )
    for case in cases:
        kind = str(case["kind"]).replace(" ", "_").replace(",", "")
        seconds = f"{case.get('seconds', 0.0):.2f}"
        tag = ET.SubElement(suite, "testcase", classname=kind, name=case["name"], time=seconds)
        if case["verdict"] == FAILED:
            legal = "".join(c if c.isprintable() else " " for c in case["reason"])  # in XML
            ET.SubElement(tag, "error", message=legal)
        elif case["verdict"] == WORSE:
            ET.SubElement(tag, "failure", message=case_words(case))
        else:
            ET.SubElement(tag, "system-out").text = case_words(case)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def case_words(case: Mapping[str, Any]) -> str:
    """Return a case's verdict in words."""
    if case["verdict"] == FAILED:
        return str(case["reason"])
    chance = "" if case["p"] is None else f" (p {chance_text(case['p'])})"
    frequency = f"{case['collide']:.0%} of {case['futures']} futures, people in {case['people_collide']:.0%}"
    p, people = (once_in(case[name]) for name in ("probability", "people"))
    return f"{case['verdict']}: collides {p}, people {people}{chance}; in {frequency}"


def title(result: Mapping[str, Any]) -> str:
    """Return function, suite and the number of cases by verdict."""
    verdicts = ", ".join(f"{result['verdicts'][name]} {name}" for name in VERDICTS)
    return f"{result['function']} on {result['suite']}: {verdicts}"


def summary_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the number, what the suite cannot see, and what changed, a line each; then the bad cases."""
    lines = [*number_lines(result), f"cannot see: {'; '.join(result['unseen'])}"]
    if change := result.get("against"):
        words = [f"{len(change[name])} {name.replace('_', ' ')}" for name in CHANGES]
        difference = change["difference"] and Rate(**change["difference"]).words()
        lines.append(
            f"against {change['function']}: {', '.join(words)}; difference, collisions an hour: {difference}"
        )
        lines += [f"{name.replace('_', ' ')}: {case}" for name in CHANGES for case in change[name]]
    bad = [case for case in result["cases"] if case["verdict"] in (WORSE, FAILED)]
    return [*lines, *(f"{case['name']}: {case_words(case)}" for case in bad)]


def number_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the number in sentences."""
    number = result["number"]
    if number is None:
        return ["every case failed: there is no number"]
    names = ("collisions_per_hour", "people_collisions_per_hour", "difference")
    function, people, difference = (Rate(**number[name]).words() for name in names)
    lines = [
        f"collisions an hour: {function}; people {people}, by the ranking of all encounters "
        f"{number['people_of_all']['collisions_per_hour']:.2g}",
        f"difference to people, collisions an hour: {difference}",
    ]
    if (needed := Rate(**number["collisions_per_hour"]).cases_needed(number["cases"])) is not None:
        lines.append(f"an interval of a factor of {NARROW:g} needs about {rounded(needed)} cases")
    return lines


def markdown_text(result: Mapping[str, Any]) -> str:
    """Return a summary for a pull request."""
    return "\n".join([f"## {title(result)}", "", *(f"- {line}" for line in summary_lines(result))]) + "\n"


_COLUMNS: Final = (
    Column("name", "case", "names"),
    Column("kind", "kind", "words"),
    Column("verdict", "verdict", "words"),
    Column(lambda case: case.get("probability"), "P(contact)", "often"),
    Column(lambda case: case.get("people"), "of people", "often"),
    Column(lambda case: case.get("p"), "p", "real", "Corrected after Holm"),
    Column(lambda case: case.get("collide"), "collide", "percent", "Share of the futures"),
    Column(lambda case: case.get("people_collide"), "people", "percent", "Share of the futures"),
    Column("weight", "stands for", "tenths", "Encounters of the data set"),
)
_SHOWN: Final = "Pictures show the future with the largest P(contact); the function drives the blue vehicle."


def write_test_page(path: Path, result: Mapping[str, Any], records: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write the page of a test, with the pictures of the workers' records by case, and return its path."""
    cases = result["cases"]
    lines = [*number_lines(result), f"cannot see: {'; '.join(result['unseen'])}"]
    function, counts = title(result).rsplit(": ", 1)
    return write_case_page(
        path,
        function,
        f"{counts}.",
        [_card(case, records[case["name"]]) for case in cases],
        filters={"kind": sorted({case["kind"] for case in cases}), "verdict": VERDICTS},
        columns=_COLUMNS,
        first=[card("The number", element("ul", *(element("li", line) for line in lines)), _SHOWN)],
    )


def _card(case: Mapping[str, Any], record: Mapping[str, Any]) -> CaseCard:
    facts = [case_words(case)]
    if case["verdict"] != FAILED:
        facts += [f"future {case['future']}: {case['how'] or 'nothing happens'}", stands_for(case["weight"])]
    title = f"{case['kind']}: {case['verdict']}"
    return CaseCard(row=case, title=title, facts=facts, shown=record if "picture" in record else {})
