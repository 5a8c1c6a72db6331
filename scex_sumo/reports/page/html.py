"""HTML of a page's fixed parts, from nested elements; all text is escaped."""

from __future__ import annotations

from html import escape

_EMPTY = {"input", "br"}


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def element(kind: str, *children: str, **attributes: str | int | bool) -> Html:
    """An element, e.g. ``element("div.card", element("h2", "Notes"), id="notes")``.

    Args:
        kind: tag with class names after dots.
        children: texts and elements.
        attributes: by name, ``_`` for ``-``; True stands without a value, False not at all.
    """
    tag, *classes = kind.split(".")
    given = {"class": " ".join(classes) or False, **attributes}
    text = "".join(
        f" {name.replace('_', '-')}" + ("" if value is True else f'="{escape(str(value))}"')
        for name, value in given.items()
        if value is not False
    )
    inside = "".join(child if isinstance(child, Html) else escape(child) for child in children)
    return Html(f"<{tag}{text}>" if tag in _EMPTY else f"<{tag}{text}>{inside}</{tag}>")


def joined(*parts: str) -> Html:
    """Elements one after the other."""
    return Html("".join(part if isinstance(part, Html) else escape(part) for part in parts))
