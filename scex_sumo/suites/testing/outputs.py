"""Outputs of a test: JUnit XML, a summary in Markdown, and the page with each case as a future that plays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

from scex_sumo.page.document import Column, card
from scex_sumo.page.html import element
from scex_sumo.reports.under_test import chance_text
from scex_sumo.results.tables.pairs import once_in, rounded
from scex_sumo.suites.estimate import NARROW, Rate
from scex_sumo.suites.page import CaseCard, stands_for, write_case_page
from scex_sumo.suites.testing.result import CHANGES, FAILED, VERDICTS, WORSE


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
        time=f"{sum(one.get('seconds', 0.0) for one in cases):.2f}",
    )
    for one in cases:
        kind = str(one["kind"]).replace(" ", "_").replace(",", "")
        case = ET.SubElement(
            suite, "testcase", classname=kind, name=one["name"], time=f"{one.get('seconds', 0.0):.2f}"
        )
        if one["verdict"] == FAILED:
            legal = "".join(c if c.isprintable() else " " for c in one["reason"])  # in XML
            ET.SubElement(case, "error", message=legal)
        elif one["verdict"] == WORSE:
            ET.SubElement(case, "failure", message=case_words(one))
        else:
            ET.SubElement(case, "system-out").text = case_words(one)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def case_words(case: Mapping[str, Any]) -> str:
    """Return a case's verdict in words."""
    if case["verdict"] == FAILED:
        return str(case["reason"])
    chance = "" if case["p"] is None else f" (p {chance_text(case['p'])})"
    often = f"{case['collide']:.0%} of {case['futures']} futures, people in {case['people_collide']:.0%}"
    p, people = (once_in(case[name]) for name in ("probability", "people"))
    return f"{case['verdict']}: collides {p}, people {people}{chance}; in {often}"


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
    bad = [one for one in result["cases"] if one["verdict"] in (WORSE, FAILED)]
    return [*lines, *(f"{one['name']}: {case_words(one)}" for one in bad)]


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
    Column(lambda one: one.get("probability"), "P(contact)", "often"),
    Column(lambda one: one.get("people"), "of people", "often"),
    Column(lambda one: one.get("p"), "p", "real", "Corrected after Holm"),
    Column(lambda one: one.get("collide"), "collide", "percent", "Share of the futures"),
    Column(lambda one: one.get("people_collide"), "people", "percent", "Share of the futures"),
    Column("weight", "stands for", "tenths", "Encounters of the data set"),
)
_SHOWN: Final = "Pictures show the future with the largest P(contact); the function drives the blue vehicle."


def write_test_page(path: Path, result: Mapping[str, Any], records: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write the page of a test and return its path.

    Args:
        records: what the workers gave, by case: its picture.
    """
    cases = result["cases"]
    lines = [*number_lines(result), f"cannot see: {'; '.join(result['unseen'])}"]
    function, counts = title(result).rsplit(": ", 1)
    return write_case_page(
        path,
        function,
        f"{counts}.",
        [_card(one, records[one["name"]]) for one in cases],
        filters={"kind": sorted({one["kind"] for one in cases}), "verdict": VERDICTS},
        columns=_COLUMNS,
        first=[card("The number", element("ul", *(element("li", line) for line in lines)), _SHOWN)],
    )


def _card(case: Mapping[str, Any], record: Mapping[str, Any]) -> CaseCard:
    facts = [case_words(case)]
    if case["verdict"] != FAILED:
        facts += [f"future {case['future']}: {case['how'] or 'nothing happens'}", stands_for(case["weight"])]
    title = f"{case['kind']}: {case['verdict']}"
    return CaseCard(row=case, title=title, facts=facts, shown=record if "picture" in record else {})
