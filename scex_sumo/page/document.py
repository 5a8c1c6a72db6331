"""Page of elements: cards, charts, sortable tables."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from numpy.typing import NDArray

from scex_sumo.base.files import write_atomic
from scex_sumo.base.version import __version__
from scex_sumo.page.html import Html, asset, element, joined
from scex_sumo.page.packing import pack
from scex_sumo.reports.words import Head

Table = Mapping[str, Any]
"""``columns`` and ``rows`` of a table, as ``assets/table.js`` shows them."""
_SCRIPTS = ("data.js", "dom.js", "table.js")  # of every page, in their order
NO_SCRIPT = element(
    "noscript",
    element("p.card", "The tables are made by the JavaScript inside of this file; it asks for nothing."),
)


class Document:
    """Page in one file that makes no request: its parts, and what its scripts read of them.

    Attributes:
        scripts: of ``assets``, beside those of every page.
        info: names and numbers for them; ``arrays`` by name.
    """

    def __init__(self, title: str, *scripts: str) -> None:
        self.title, self.scripts = title, scripts or ("study.js",)
        self.info: dict[str, Any] = {"tables": {}}
        self.arrays: Mapping[str, NDArray[Any]] = {}

    def table(self, name: str, table: Table) -> Html:
        """Add a table, see `page_table`, and return the place where it is shown."""
        self.info["tables"][name] = table
        return element("div.scroll", id=name)

    def write(self, path: Path, about: str, *parts: Html) -> Path:
        """Write the page with its title above its parts, and return its path."""
        header = element("header", element("div", element("h1", self.title), element("p", about)))
        footer = element("footer.soft", f"scex-sumo {__version__}")
        write_atomic(path, self.html(joined(header, NO_SCRIPT, element("div.study", *parts), footer)))
        return path

    def filled(self, template: str, **parts: str) -> bytes:
        """Return the page with the parts of a template in ``assets`` as its body; texts are escaped."""
        return self.html(Template(asset(template)).substitute({k: joined(text) for k, text in parts.items()}))

    def html(self, body: str) -> bytes:
        """Return the page."""
        style, names = asset("page.css"), (*_SCRIPTS, *self.scripts)
        # Indentation and lines of comment are an eighth.
        scripts = "\n".join(re.sub(r"(?m)^(\s+|//.*\n)+", "", asset(name)) for name in names)
        script = f'"use strict";\n(() => {{\n{scripts}\n}})();'
        policy = (
            "default-src 'none'; base-uri 'none'; form-action 'none'; img-src blob: data:; media-src blob:; "
            f"script-src {_hash(script)}; style-src {_hash(style)}"
        )
        page = {"policy": policy, "style": style, "script": script, "data": pack(self.info, self.arrays)}
        return Template(asset("page.html")).substitute(page, title=escape(self.title), body=body).encode()


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def card(title: str, *children: str) -> Html:
    """Return a card with a heading; plain sentences become paragraphs."""
    inside = [child if isinstance(child, Html) else element("p.soft", child) for child in children]
    return element("section.card", element("h2", title), *inside)


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
