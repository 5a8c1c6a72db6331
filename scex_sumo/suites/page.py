"""Pages of suites and tests: cases as cards that play, filtered by what they are, and a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from scex_sumo.page.columns import Column, page_table
from scex_sumo.page.document import Document, Table, card
from scex_sumo.page.html import Html, element
from scex_sumo.reports.words import counted
from scex_sumo.results.tables.pairs import once_in

SCRIPTS: Final = ("loop.js", "stage.js", "cases.js")
COVERAGE: Final = (
    Column("kind", "kind", "names"),
    Column(lambda row: f"{row['people_collide_per_hour']:.1g}", "people collide an hour"),
    Column("candidates", "candidates"),
    Column("cases", "cases"),
)
"""Candidates and cases of each kind."""
_KEYS: Final = "A click on a picture holds it. Mark cases to get the command that runs these alone."
_COLUMNS: Final = (
    Column("name", "case", "names"),
    Column("kind", "kind", "words"),
    Column("site", "site", "words"),
    Column("recording", "recording", "words"),
    Column("time_s", "time", "seconds"),
    Column("probability", "P(contact)", "often", "Of people"),
    Column("weight", "stands for", "tenths", "Encounters of the data set"),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class CaseCard:
    """What a page shows of a case.

    Attributes:
        row: with ``name`` and the columns of filters and table.
        shown: ``picture``, ``outlines`` and ``contact`` as of a `Stage`; without any: no picture.
    """

    row: Mapping[str, Any]
    title: str
    facts: Sequence[str]
    shown: Mapping[str, Any]

    def html(self) -> Html:
        """Return the card with its picture and a mark."""
        name = self.row["name"]
        mark = element("label", element("input", type="checkbox", data_mark=True), " mark")
        return element(
            "article.card",
            element("h2", element("b", name[:3]), f" {self.title}"),
            Html(self.shown["picture"]) if self.shown else element("p.soft", "no future"),
            element("ul", *(element("li", fact) for fact in self.facts)),
            element("div.row", mark, element("code", f"cases/{name}")),
            id=name,
            tabindex="0",
        )


def write_case_page(
    path: Path,
    title: str,
    about: str,
    cards: Sequence[CaseCard],
    *,
    filters: Mapping[str, Sequence[str]],
    columns: Sequence[Column],
    first: Sequence[Html] = (),
    last: Table | None = None,
) -> Path:
    """Write a page of cases and return its path.

    Args:
        filters: values by column of the rows.
        columns: of the table of all cases.
        first: cards above the cases.
        last: one more table.
    """
    lists = []
    for name, values in filters.items():
        options = [element("option", value or "all", value=value) for value in ("", *values)]
        lists.append(element("label", f"{name} ", element("select", *options, data_filter=name)))
    bar = element("div.row", element("b", id="counts"), *lists)
    page, table = Document(title, *SCRIPTS), page_table(columns, [case_card.row for case_card in cards])
    parts = [
        *first,
        element("section.card", bar, element("p.soft", _KEYS), element("p.soft", id="said", role="status")),
        element("div.moments", *(case_card.html() for case_card in cards), id="cards"),
        card("All cases", page.table("all-cases", table)),
    ]
    if last is not None:
        parts.append(card("Candidates and cases", page.table("last", last)))
    page.info["cards"] = [
        {name: case_card.shown.get(name) for name in ("outlines", "contact")}
        | {"name": case_card.row["name"], "about": {name: case_card.row[name] for name in filters}}
        for case_card in cards
    ]
    return page.write(path, about, *parts)


def write_catalogue_page(path: Path, info: Mapping[str, Any], cards: Sequence[CaseCard]) -> Path:
    """Write the page of a suite and return its path."""
    sites = sorted({case_card.row["site"] for case_card in cards})
    filters = {"kind": [of_kind["kind"] for of_kind in info["exposure"]], "site": sites}
    about, last = f"{population_words(info)}.", page_table(COVERAGE, info["exposure"])
    return write_case_page(path, "Catalogue", about, cards, filters=filters, columns=_COLUMNS, last=last)


def catalogue_card(candidate: Mapping[str, Any], how: str | None, shown: Mapping[str, Any]) -> CaseCard:
    """Return the card of a candidate with its entry of ``suite.json``."""
    facts = [
        f"{candidate['recording']}, {candidate['time_s']:g} s; the function drives {candidate['track_id']}",
        f"people: {how or 'nothing happens'}; they collide {once_in(candidate['probability'])}",
        stands_for(candidate["weight"]),
    ]
    return CaseCard(row=candidate, title=candidate["kind"], facts=facts, shown=shown)


def stands_for(weight: float) -> str:
    """Return for how many encounters a case stands, in words."""
    return f"stands for {weight:.3g} encounter{'' if f'{weight:.3g}' == '1' else 's'}"


def population_words(info: Mapping[str, Any]) -> str:
    """Return what the cases of a suite stand for, in words."""
    return (
        f"{counted(len(info['cases']), 'case')} for {counted(info['encounters'], 'encounter')} of "
        f"{info['hours']:.2g} h; people collide {info['people']['collisions_per_hour']:.1g} times an hour in "
        f"them; left out: {info['rare']} with P below 1e-6, {info['doubtful']} with doubtful data"
    )
