"""Tables of studies, described once for pages and terminals, and the card of what failed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from rich.console import Console

from scex_sumo.page.document import Table, card, table
from scex_sumo.page.html import Html, element
from scex_sumo.reports.console_table import console_table, print_table

Row: TypeAlias = Mapping[str, Any]
_FAILURES_SHOWN = 20


class Column(NamedTuple):
    """Column of a table: cells by key or function of a row; title, form and hint as of `Head`."""

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
    """Print rows as a table; ``breaks`` as of `print_table`."""
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
