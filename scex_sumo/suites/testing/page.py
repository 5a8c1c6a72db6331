"""Page of a test: the number, and each case as a future that plays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from scex_sumo.page.document import Column, card
from scex_sumo.page.html import element
from scex_sumo.suites.page import CaseCard, stands_for, write_case_page
from scex_sumo.suites.testing.outputs import case_words, number_lines, title
from scex_sumo.suites.testing.result import FAILED, VERDICTS

_COLUMNS: Final = (
    Column("name", "case", "names"),
    Column("kind", "kind", "words"),
    Column("verdict", "verdict", "words"),
    Column(lambda one: one.get("probability"), "P(contact)", "often"),
    Column(lambda one: one.get("people"), "of people", "often"),
    Column(lambda one: one.get("p"), "p", "real", "Corrected after Holm"),
    Column(lambda one: one.get("collide"), "collide", "percent", "Share of the futures"),
    Column(lambda one: one.get("people_collide"), "people", "percent", "Share of the futures"),
    Column(lambda one: one.get("hardest_mps2"), "hardest braking", "tenths", "m/s²"),
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
        facts += [
            f"future {case['future']}: {case['how'] or 'nothing happens'}",
            f"hardest braking {case['hardest_mps2']:.1f} m/s²; {stands_for(case['weight'])}",
        ]
    title = f"{case['kind']}: {case['verdict']}"
    return CaseCard(row=case, title=title, facts=facts, shown=record if "picture" in record else {})
