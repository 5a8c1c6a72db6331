"""Files of a test for continuous integration: JUnit XML and a summary in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final
from xml.etree import ElementTree as ET

from scex_sumo.certainty.response.answer import once_in
from scex_sumo.studies.under_test.table import chance_text
from scex_sumo.suites.estimate import Rate
from scex_sumo.suites.testing.result import FAILED, VERDICTS, WORSE, verdicts_by_kind

DECIDES: Final = 0.5
"""Share of the collisions in one case from which the interval is doubtful."""


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
            ET.SubElement(case, "error", message=_legal(one["reason"]))
        elif one["verdict"] == WORSE:
            ET.SubElement(case, "failure", message=case_words(one))
        else:
            ET.SubElement(case, "system-out").text = case_words(one)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _legal(text: str) -> str:
    """Return a text without characters that XML does not allow."""
    return "".join(c if c.isprintable() else " " for c in text)


def case_words(case: Mapping[str, Any]) -> str:
    """Return a case's verdict in words."""
    if case["verdict"] == FAILED:
        return str(case["reason"])
    return (
        f"{case['verdict']}: touches in {case['contacts']} of {case['futures']} futures, people in "
        f"{case['people_contacts']:.1f} (p {chance_text(case['p'])}); on the road: "
        f"{once_in(case['probability'])}, people {once_in(case['people'])}"
    )


def rate_words(rate: Mapping[str, Any]) -> str:
    """Return a rate and its interval."""
    return Rate(**rate).words()


def number_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the number in sentences."""
    number = result["number"]
    if number is None:
        return ["every case failed: there is no number"]
    largest = number["largest"]
    doubt = (
        f"{largest['share']:.0%} of the collisions are of one case, {largest['name']}, that stands for others"
    )
    return [
        f"collisions an hour: {rate_words(number['collisions_per_hour'])}; people "
        f"{rate_words(number['people_collisions_per_hour'])}, in all of the data set "
        f"{number['people_of_all']['collisions_per_hour']:.2g}",
        f"severe injuries an hour: {rate_words(number['severe_per_hour'])}; people "
        f"{rate_words(number['people_severe_per_hour'])}",
        f"difference to people, collisions an hour: {rate_words(number['difference'])}",
        *([f"{doubt}: intervals are too narrow"] if largest["share"] > DECIDES else []),
    ]


def markdown_text(result: Mapping[str, Any]) -> str:
    """Return a summary for a pull request."""
    verdicts = ", ".join(f"{result['verdicts'][name]} {name}" for name in VERDICTS)
    lines = [f"## {result['function']} on {result['suite']}: {verdicts}", ""]
    lines += [f"- {line}" for line in number_lines(result)]
    lines += ["", f"| kind | {' | '.join(VERDICTS)} |", f"|---|{'---|' * len(VERDICTS)}"]
    for kind, counts in verdicts_by_kind(result["cases"]).items():
        lines.append(f"| {kind} | {' | '.join(map(str, counts.values()))} |")
    bad = [one for one in result["cases"] if one["verdict"] in (WORSE, FAILED)]
    if bad:
        lines += ["", *(f"- `{one['name']}` {case_words(one)}" for one in bad)]
    lines += ["", "Not seen:", *(f"- {words}" for words in result["unseen"])]
    return "\n".join([*lines, *_against(result.get("against"))]) + "\n"


def _against(change: Mapping[str, Any] | None) -> Sequence[str]:
    if change is None:
        return []
    return [
        "",
        f"Against {change['function']}: {change['same']} the same",
        *(f"- better: `{name}`" for name in change["became_better"]),
        *(f"- worse: `{name}`" for name in change["became_worse"]),
    ]
