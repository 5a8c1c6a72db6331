"""Page of a study: cards, charts, sortable tables; tables described once for pages and terminals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

from rich.console import Console

from scex_sumo.base.files import write_atomic
from scex_sumo.base.version import __version__
from scex_sumo.page.html import BASE, Html, element, joined, page_html
from scex_sumo.reports.run_table import Head, console_table, print_table

Row: TypeAlias = Mapping[str, Any]
Table = Mapping[str, Any]
"""``columns`` and ``rows`` of a table, as ``assets/table.js`` shows them."""
_FAILURES_SHOWN = 20
NO_SCRIPT = element(
    "noscript",
    element("p.card", "The tables are made by the JavaScript inside of this file; it asks for nothing."),
)


def write_study(
    path: Path,
    title: str,
    about: str,
    *cards: Html,
    tables: Mapping[str, Table],
    scripts: Sequence[str] = ("study.js",),
    info: Mapping[str, Any] = MappingProxyType({}),
) -> Path:
    """Write a page and return its path; see `card` and `table_place` for its parts.

    Args:
        scripts: of the page, beside those of every page.
        info: for them.
    """
    header = element("header", element("div", element("h1", title), element("p", about)))
    footer = element("footer.soft", f"scex-sumo {__version__}")
    body = joined(header, NO_SCRIPT, element("div.study", *cards), footer)
    write_atomic(path, page_html(title, body, (*BASE, *scripts), {"tables": tables, **info}, {}).encode())
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
    down = form in ("real", "percent", "often", "tenths")
    return column | {"as": form, "down": down} | ({"kind": "names"} if names else {})


class Column(NamedTuple):
    """Column of a table.

    Attributes:
        cell: key of the rows, or function of a row.
        title: its head.
        form: as of `Head`.
        hint: what the head means.
    """

    cell: str | Callable[[Row], Any]
    title: str
    form: str = "text"
    hint: str = ""

    def of(self, row: Row) -> Any:
        """Return the cell of a row."""
        return self.cell(row) if callable(self.cell) else row[self.cell]


def page_table(columns: Sequence[Column], rows: Iterable[Row]) -> Table:
    """Return a sortable table of a page."""
    return table([column[1:] for column in columns], _cells(columns, rows))


def print_columns(
    columns: Sequence[Column],
    rows: Iterable[Row],
    console: Console,
    title: str,
    caption: str | None = None,
    *,
    breaks: Sequence[str] = (),
) -> None:
    """Print rows as a table.

    Args:
        breaks: as of `print_table`.
    """
    cells = _cells(columns, rows)
    table = console_table(title, [column[1:] for column in columns], cells, caption=caption)
    print_table(table, console, breaks=breaks)


def _cells(columns: Sequence[Column], rows: Iterable[Row]) -> list[list[Any]]:
    return [[column.of(row) for column in columns] for row in rows]


def failure_card(title: str, reasons: Mapping[str, str]) -> list[Html]:
    """Return the card of failed moments, those of one reason together; none without a failure."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        by_reason.setdefault(reason, []).append(name)
    most = sorted(by_reason.items(), key=lambda item: -len(item[1]))[:_FAILURES_SHOWN]
    items = [
        element("li", f"{reason} ({len(names)}: {', '.join(names[:3])}{', ...' if names[3:] else ''})")
        for reason, names in most
    ]
    return [card(title, element("ul", *items))] if items else []
