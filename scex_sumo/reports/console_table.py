"""Tables and sentences for the terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scex_sumo.reports.words import Head

_FORMS = {"real": "{:.2f}", "percent": "{:.1%}", "seconds": "{:.1f} s", "metres": "{:.1f} m"}
_MIN_FOLDED = 12  # characters of a folded column


def print_line(text: str, console: Console) -> None:
    """Print a sentence; only terminals break it, between words."""
    indent = len(text) - len(text.lstrip())
    wide = console.size.width if console.is_terminal else len(text) + 1
    wrapped = textwrap.wrap(text, wide, subsequent_indent=" " * (indent + 2), break_on_hyphens=False)
    console.print(Text("\n".join(wrapped)), soft_wrap=True)


def console_table(
    title: str, heads: Sequence[Head], rows: Iterable[Sequence[Any] | None], *, caption: str | None = None
) -> Table:
    """Return a table for the terminal; None and NaN are dashes, words may fold, a row None begins a part."""
    table = Table(title=title, title_justify="left", caption=caption, caption_justify="left")
    for name, form, _ in heads:
        left, words = form in ("names", "words"), form == "words"
        style: dict[str, Any] = {"overflow": "fold"} if words else {"no_wrap": True}
        table.add_column(Text(name), justify="left" if left else "right", **style)
    forms = [f"{{:{form}}}" if form[:1] == "." else _FORMS.get(form, "{}") for _, form, _ in heads]
    for row in rows:
        if row is None:
            table.add_section()
        else:
            cells = zip(forms, row, strict=True)
            table.add_row(*(Text("–" if c is None or c != c else form.format(c)) for form, c in cells))
    return table


def print_table(table: Table, console: Console, *, breaks: Sequence[str] = ()) -> None:
    """Print a table; a narrow terminal gets no frame, and no cell is cut off.

    Args:
        table: only columns with overflow ``fold`` may take several lines.
        console: becomes as wide as the table needs.
        breaks: parts of headers that begin a new line on a narrow terminal.
    """
    unlimited = console.options.update(max_width=1000)
    if console.measure(table, options=unlimited).maximum > console.width:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
        for column in table.columns:
            for ending in breaks:
                column.header = Text(str(column.header).replace(ending, f"\n{ending.strip()}"))
        folded = [c for c in table.columns if c.overflow == "fold"]
        spare = sum(max(0, *(cell_len(str(cell)) for cell in c.cells)) - _MIN_FOLDED for c in folded)
        needed = console.measure(table, options=unlimited).maximum
        console.width = max(console.width, needed - max(0, spare))
    console.print(table)
