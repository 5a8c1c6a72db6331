"""Page of a study: headings, sentences, charts and tables that sort, in the shell of the reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scex_sumo.files import write_atomic
from scex_sumo.reports.page.html import Html, element, joined
from scex_sumo.reports.page.shell import BASE, page_html
from scex_sumo.version import __version__

Table = Mapping[str, Any]
"""``columns`` and ``rows`` of a table, as ``assets/table.js`` shows them."""
NO_SCRIPT = element(
    "noscript",
    element("p.card", "The tables are made by the JavaScript inside of this file; it asks for nothing."),
)


def write_study(path: Path, title: str, about: str, *cards: Html, tables: Mapping[str, Table]) -> Path:
    """Write a page.

    Args:
        path: HTML file.
        title: of the page.
        about: a line below the title.
        cards: what is on it, see `card`.
        tables: by the id of the element that they are shown in, see `place`.

    Returns:
        The file.
    """
    header = element("header", element("div", element("h1", title), element("p", about)))
    footer = element("footer.soft", f"scex-sumo {__version__}")
    body = joined(header, NO_SCRIPT, element("div.study", *cards), footer)
    write_atomic(path, page_html(title, body, (*BASE, "study.js"), {"tables": tables}, {}).encode())
    return path


def card(title: str, *parts: str) -> Html:
    """A part of a page under a heading; sentences become paragraphs."""
    inside = [part if isinstance(part, Html) else element("p.soft", part) for part in parts]
    return element("section.card", element("h2", title), *inside)


def table_place(name: str) -> Html:
    """Where a table is shown."""
    return element("div.scroll", id=name)


def plots(*figures: Html) -> Html:
    """Charts side by side."""
    return element("div.plots", *figures)


def table(heads: Sequence[tuple[str, str, str]], rows: Sequence[Sequence[Any]]) -> Table:
    """A table that sorts.

    Args:
        heads: title, format as in ``assets/table.js`` (text, real, percent, seconds, metres, words), hint.
        rows: cells; None where there is nothing.
    """
    columns = [_column(*head, [row[i] for row in rows]) for i, head in enumerate(heads)]
    return {"columns": columns, "rows": [{"cells": list(row)} for row in rows]}


def _column(title: str, form: str, hint: str, cells: Sequence[Any]) -> dict[str, Any]:
    column: dict[str, Any] = {"title": title} | ({"hint": hint} if hint else {})
    if form == "words":
        return column | {"kind": "words"}
    names = form == "text" and any(isinstance(cell, str) and cell[:1].isalpha() for cell in cells)
    return column | {"as": form, "down": form != "text"} | ({"kind": "names"} if names else {})
