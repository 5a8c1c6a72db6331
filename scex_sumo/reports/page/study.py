"""Page of a study: cards, charts and sortable tables in the shell of the reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scex_sumo.base.files import write_atomic
from scex_sumo.base.version import __version__
from scex_sumo.reports.page.html import BASE, Html, element, joined, page_html
from scex_sumo.reports.run_table import Head

Table = Mapping[str, Any]
"""``columns`` and ``rows`` of a table, as ``assets/table.js`` shows them."""
NO_SCRIPT = element(
    "noscript",
    element("p.card", "The tables are made by the JavaScript inside of this file; it asks for nothing."),
)


def write_study(path: Path, title: str, about: str, *cards: Html, tables: Mapping[str, Table]) -> Path:
    """Write a page and return its path; see `card` and `table_place` for its parts."""
    header = element("header", element("div", element("h1", title), element("p", about)))
    footer = element("footer.soft", f"scex-sumo {__version__}")
    body = joined(header, NO_SCRIPT, element("div.study", *cards), footer)
    write_atomic(path, page_html(title, body, (*BASE, "study.js"), {"tables": tables}, {}).encode())
    return path


def card(title: str, *parts: str) -> Html:
    """Return a card with a heading; plain sentences become paragraphs."""
    inside = [part if isinstance(part, Html) else element("p.soft", part) for part in parts]
    return element("section.card", element("h2", title), *inside)


def table_place(name: str) -> Html:
    """Return the place of the table with this id."""
    return element("div.scroll", id=name)


def plots(*figures: Html) -> Html:
    """Return charts side by side."""
    return element("div.plots", *figures)


def table(heads: Sequence[Head], rows: Sequence[Sequence[Any]]) -> Table:
    """Return a sortable table; None is an empty cell."""
    columns = [_column(*head, [row[i] for row in rows]) for i, head in enumerate(heads)]
    return {"columns": columns, "rows": [{"cells": list(row)} for row in rows]}


def _column(title: str, form: str, hint: str, cells: Sequence[Any]) -> dict[str, Any]:
    column: dict[str, Any] = {"title": title} | ({"hint": hint} if hint else {})
    if form in ("names", "words"):
        return column | {"kind": form}
    names = form == "text" and any(isinstance(cell, str) and cell[:1].isalpha() for cell in cells)
    return column | {"as": form, "down": form in ("real", "percent")} | ({"kind": "names"} if names else {})
