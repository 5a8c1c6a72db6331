"""HTML elements, and the shell of a page with scripts, styles and packed data."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from numpy.typing import NDArray

from scex_sumo.page.packing import pack

BASE = ("data.js", "dom.js", "table.js")
"""Scripts of every page in their order; a page adds its own."""
_EMPTY = {"input", "br"}


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def element(kind: str, *children: str, **attributes: str | int | bool) -> Html:
    """Return an element with escaped texts, e.g. ``element("div.card", element("h2", "Notes"), id="notes")``.

    In attribute names ``_`` stands for ``-``; True writes the name alone, False nothing.
    """
    tag, *classes = kind.split(".")
    given = {"class": " ".join(classes) or False, **attributes}
    text = "".join(
        f" {name.replace('_', '-')}" + ("" if value is True else f'="{escape(str(value))}"')
        for name, value in given.items()
        if value is not False
    )
    return Html(f"<{tag}{text}>" if tag in _EMPTY else f"<{tag}{text}>{joined(*children)}</{tag}>")


def joined(*parts: str) -> Html:
    """Return elements and escaped texts in a row."""
    return Html("".join(part if isinstance(part, Html) else escape(part) for part in parts))


def page_html(
    title: str,
    body: str,
    scripts: Sequence[str],
    info: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
) -> str:
    """Return a page that makes no request; ``info`` and ``arrays`` are for its scripts."""
    style = asset("page.css")
    script = '"use strict";\n(() => {\n' + "\n".join(map(_script, scripts)) + "\n})();"
    return Template(asset("page.html")).substitute(
        title=escape(title),
        policy=(
            "default-src 'none'; base-uri 'none'; form-action 'none'; img-src blob: data:; media-src blob:; "
            f"script-src {_hash(script)}; style-src {_hash(style)}"
        ),
        style=style,
        body=body,
        data=pack(info, arrays),
        script=script,
    )


def asset(name: str) -> str:
    """Return the text of a file in ``assets``."""
    return files("scex_sumo.page").joinpath("assets", name).read_text(encoding="utf-8")


def _script(name: str) -> str:
    """Return a script without indentation and lines of comment, which are an eighth of it."""
    return re.sub(r"(?m)^(\s+|//.*\n)+", "", asset(name))


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
