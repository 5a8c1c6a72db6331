"""HTML elements with escaped texts, and the files of ``assets``."""

from __future__ import annotations

from html import escape
from importlib.resources import files

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


def joined(*children: str) -> Html:
    """Return elements and escaped texts in a row."""
    return Html("".join(child if isinstance(child, Html) else escape(child) for child in children))


def asset(name: str) -> str:
    """Return the text of a file in ``assets``."""
    return files("scex_sumo.page").joinpath("assets", name).read_text(encoding="utf-8")
