"""Page of a catalogue: coverage before and after, and the cases as cards that play."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from scex_sumo.certainty.response.answer import once_in
from scex_sumo.page.html import Html, element
from scex_sumo.page.study import Column, card, page_table, table_place, write_study
from scex_sumo.reports.run_table import counted
from scex_sumo.studies.rank.stage import Stage
from scex_sumo.suites.population import RISK_WORDS

SCRIPTS: Final = ("loop.js", "stage.js", "cases.js")
_KEYS: Final = (
    "Mark cases, and copy the command that runs these alone, or save their list ('--cases cases.txt'). "
    "Without marks the list has the cases that are shown. A click on a picture holds it."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseCard:
    """What the page shows of a case.

    Attributes:
        row: the candidate, with name, kind, risk and weight.
        words: the action.
    """

    row: Mapping[str, Any]
    stage: Stage
    words: str


def write_catalogue_page(path: Path, info: Mapping[str, Any], cards: Sequence[CaseCard]) -> Path:
    """Write the page of a suite and return its path."""
    about = (
        f"{counted(len(cards), 'case')} for {counted(info['candidates'], 'candidate')} in "
        f"{info['encounters']} encounters of {info['hours']:.2g} h; {info['doubtful']} with doubtful data "
        "left out. "
        f"People collide {info['people']['collisions_per_hour']:.1g} times an hour in them."
    )
    filters = {
        "kind": [row["kind"] for row in info["coverage"]],
        "risk": [word for word in RISK_WORDS if any(_about(one)["risk"] == word for one in cards)],
        "site": sorted({one.row["location"] for one in cards}),
    }
    parts = [
        card("Coverage", _COVERAGE, coverage_table(info["coverage"])),
        filter_bar(filters, _KEYS, save=True),
        element("div.moments", *(_card(one) for one in cards), id="cards"),
        card("All cases", table_place("all-cases")),
    ]
    data = [
        {
            "name": one.row["name"],
            "outlines": one.stage.outlines,
            "contact": one.stage.contact,
            "about": _about(one),
        }
        for one in cards
    ]
    tables = {"all-cases": page_table(_COLUMNS, [one.row for one in cards])}
    return write_study(path, "Catalogue", about, *parts, tables=tables, scripts=SCRIPTS, info={"cards": data})


_COVERAGE: Final = (
    "Candidates of each kind by P of a contact of people: all of the data set → cases of the suite. A click "
    "shows the cases."
)
_COLUMNS: Final = (
    Column("name", "case", "names"),
    Column("conflict", "kind", "words"),
    Column("location", "site", "words"),
    Column("recording", "recording", "words"),
    Column("time_s", "time", "seconds"),
    Column("probability", "P(contact)", "often", "Of people"),
    Column("weight", "stands for", "tenths", "Candidates of the data set"),
)


def _about(case: CaseCard) -> dict[str, str]:
    row = case.row
    return {"kind": row["kind"], "risk": RISK_WORDS[row["risk"]], "site": row["location"]}


def coverage_table(rows: Iterable[Mapping[str, Any]]) -> Html:
    """Return the table of kinds and risk, before and after; a cell asks for its cases."""
    cells = {
        row["kind"]: [
            (f"{before} → {after}" if before else "", after > 0)
            for before, after in zip(row["before"], row["after"], strict=True)
        ]
        for row in rows
    }
    return kind_table("risk", RISK_WORDS, cells)


def kind_table(
    filter_name: str, values: Sequence[str], rows: Mapping[str, Sequence[tuple[str, bool]]]
) -> Html:
    """Return a table of kinds by the values of a filter.

    Args:
        rows: by kind, for each value the words of its cell, and whether it has cases, for which it asks.
    """
    head = element("tr", element("th", "kind"), *(element("th", value) for value in values))
    body = []
    for kind, cells in rows.items():
        row = []
        for value, (words, has_cases) in zip(values, cells, strict=True):
            wanted = json.dumps({"kind": kind, filter_name: value})
            row.append(element("td", element("button", words, data_cell=wanted) if has_cases else words))
        body.append(element("tr", element("th", kind), *row))
    return element("div", element("table", element("thead", head), element("tbody", *body)))


def filter_bar(filters: Mapping[str, Sequence[str]], words: str, *, save: bool) -> Html:
    """Return the bar with a list of choices for each filter."""
    lists = [
        element(
            "label",
            f"{name} ",
            element(
                "select",
                element("option", "all", value=""),
                *(element("option", value, value=value) for value in values),
                data_filter=name,
            ),
        )
        for name, values in filters.items()
    ]
    button = [element("button", "save list", id="save")] if save else []
    row = element("div.row", element("b", id="counts"), *lists, *button)
    return element("section.card", row, element("p.soft", words), element("p.soft", id="said", role="status"))


def _card(case: CaseCard) -> Html:
    row = case.row
    who = row["person"] or row["track_id"]
    facts = [
        f"{who} {case.words}; the function drives {row['other_id']}",
        f"people touch: {once_in(row['probability'])}",
        f"stands for {counted(round(row['weight']), 'candidate')}",
    ]
    mark = element("label", element("input", type="checkbox", data_mark=True), " mark")
    return element(
        "article.card",
        element("h2", element("b", row["name"][:3]), f" {row['kind']}"),
        element("p.soft", f"{row['location']}, {row['recording']}, {row['time_s']:g} s"),
        case.stage.picture,
        element("ul", *(element("li", fact) for fact in facts)),
        element("div.row", mark, element("code", f"cases/{row['name']}")),
        id=row["name"],
        tabindex="0",
    )
