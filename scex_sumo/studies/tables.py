"""Tables of studies, described once for files, pages and terminals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from scex_sumo.reports.page.html import Html, element
from scex_sumo.reports.page.study import Table, card, table

if TYPE_CHECKING:
    from rich.console import Console

Row: TypeAlias = Mapping[str, Any]
FAILURES_SHOWN = 20


class Column(NamedTuple):
    """Column of a table.

    Attributes:
        cell: key of the rows, or function of a row.
        title: its head.
        form: text, real, percent, seconds, metres or words; in a terminal a format such as ``.2f``.
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
    cells = [[column.of(row) for column in columns] for row in rows]
    return table([column[1:] for column in columns], cells)


def print_columns(
    columns: Sequence[Column],
    rows: Iterable[Row],
    console: Console,
    title: str,
    caption: str | None = None,
    *,
    grouped: bool = False,
) -> None:
    """Print rows as a table; words stand left. ``grouped``: rows of one first cell are a section."""
    from rich.table import Table as Printed

    from scex_sumo.reports.run_table import print_table

    printed = Printed(title=title, title_justify="left", caption=caption, caption_justify="left")
    for column in columns:
        if column.form == "words":
            printed.add_column(column.title, overflow="fold")
        else:
            printed.add_column(column.title, justify="right", no_wrap=True)
    last = None
    for row in rows:
        cells = [_printed(column.of(row), column.form) for column in columns]
        if grouped and last not in (None, cells[0]):
            printed.add_section()
        last, cells[0] = cells[0], "" if grouped and cells[0] == last else cells[0]
        printed.add_row(*cells)
    print_table(printed, console)


def _printed(cell: Any, form: str) -> str:
    if cell is None:
        return "–"
    return str(cell) if form in ("text", "words") else format(cell, form)


def failure_card(title: str, reasons: Mapping[str, str]) -> list[Html]:
    """Return the card of failed moments, those of one reason together; none without a failure."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        by_reason.setdefault(reason, []).append(name)
    most = sorted(by_reason.items(), key=lambda item: -len(item[1]))[:FAILURES_SHOWN]
    items = [
        element("li", f"{reason} ({len(names)}: {', '.join(names[:3])}{', ...' if names[3:] else ''})")
        for reason, names in most
    ]
    return [card(title, element("ul", *items))] if items else []
