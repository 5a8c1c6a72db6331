"""Page of a test: kinds by verdict, and each case as a future that plays."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from scex_sumo.page.html import Html, element
from scex_sumo.page.study import Column, card, page_table, table_place, write_study
from scex_sumo.suites.page import SCRIPTS, filter_bar, kind_table
from scex_sumo.suites.testing.outputs import case_words, number_lines
from scex_sumo.suites.testing.result import FAILED, VERDICTS, verdicts_by_kind

_COLUMNS: Final = (
    Column("name", "case", "names"),
    Column("kind", "kind", "words"),
    Column("verdict", "verdict", "words"),
    Column(lambda one: one.get("contacts"), "contacts", "tenths", "Futures in which the two touch"),
    Column(lambda one: one.get("people_contacts"), "people", "tenths", "Expected contacts of people in them"),
    Column(lambda one: one.get("p"), "p", "real", "Corrected after Holm"),
    Column(lambda one: one.get("probability"), "P(contact)", "often"),
    Column(lambda one: one.get("people"), "of people", "often"),
    Column(lambda one: one.get("hardest_mps2"), "hardest braking", "tenths", "m/s²"),
    Column(lambda one: one.get("ttc_s"), "least TTC", "real", "Median of the futures, s"),
    Column("weight", "stands for", "tenths", "Candidates of the data set"),
)
_SHOWN: Final = (
    "Each picture shows the most frequent future with a contact, else that in which they come nearest. "
    "The function drives the blue vehicle. A click on a number of the table shows its cases."
)


def write_test_page(path: Path, result: Mapping[str, Any], records: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write the page of a test and return its path.

    Args:
        records: what the workers gave, by case: its picture.
    """
    cases = result["cases"]
    counts = ", ".join(f"{result['verdicts'][name]} {name}" for name in VERDICTS)
    by_kind = verdicts_by_kind(cases)
    filters = {"kind": [*by_kind], "verdict": list(VERDICTS)}
    unseen = element("ul", *(element("li", words) for words in result["unseen"]))
    number = element("ul", *(element("li", line) for line in number_lines(result)))
    parts = [
        card("The number", number),
        card("Kinds by verdict", _verdicts(by_kind)),
        filter_bar(filters, _SHOWN, save=True),
        element("div.moments", *(_card(one, records[one["name"]]) for one in cases), id="cards"),
        card("All cases", table_place("all-cases")),
        card("What the suite cannot see", unseen),
    ]
    data = [_data(one, records[one["name"]]) for one in cases]
    title = f"{result['function']} on {result['suite']}"
    tables = {"all-cases": page_table(_COLUMNS, cases)}
    return write_study(
        path, title, f"{counts}.", *parts, tables=tables, scripts=SCRIPTS, info={"cards": data}
    )


def _data(case: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "name": case["name"],
        "outlines": record.get("outlines"),
        "contact": record.get("contact"),
        "about": {"kind": case["kind"], "verdict": case["verdict"]},
    }


def _verdicts(by_kind: Mapping[str, Mapping[str, int]]) -> Html:
    rows = {
        kind: [(str(count or ""), count > 0) for count in counts.values()] for kind, counts in by_kind.items()
    }
    return kind_table("verdict", VERDICTS, rows)


def _card(case: Mapping[str, Any], record: Mapping[str, Any]) -> Html:
    picture = Html(record["picture"]) if "picture" in record else element("p.soft", "no future")
    facts = [case_words(case)]
    if case["verdict"] != FAILED:
        facts.append(f"{case['action']}; touches another vehicle in {case['others']} futures")
        if case["struck"]:
            facts.append(f"stands when it is hit in {case['struck']} futures")
        facts.append(
            f"hardest braking {case['hardest_mps2']:.1f} m/s², stands for {case['weight']:.0f} candidates"
        )
    return element(
        "article.card",
        element("h2", element("b", case["name"][:3]), f" {case['kind']}: {case['verdict']}"),
        picture,
        element("ul", *(element("li", fact) for fact in facts)),
        element("label", element("input", type="checkbox", data_mark=True), " mark"),
        id=case["name"],
        tabindex="0",
    )
