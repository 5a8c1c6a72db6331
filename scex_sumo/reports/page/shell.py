"""Shell of a page: our own scripts and styles with packed data in one file, without any request."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from numpy.typing import NDArray

from scex_sumo.reports.page.packing import pack

COMPONENTS = ("data.js", "state.js", "table.js", "chart.js", "map.js", "pairs.js")
"""What pages are made of, in the order in which it is put together; a page adds its own script."""


def page_html(
    title: str,
    body: str,
    scripts: Sequence[str],
    info: Mapping[str, Any],
    arrays: Mapping[str, NDArray[Any]],
) -> str:
    """A page as HTML.

    Args:
        title: of the page.
        body: name of an asset with what is inside of the body.
        scripts: names of assets, in order.
        info: words and single numbers for the scripts.
        arrays: arrays for the scripts.
    """
    style = asset("page.css")
    script = '"use strict";\n(() => {\n' + "\n".join(asset(name) for name in scripts) + "\n})();"
    return Template(asset("page.html")).substitute(
        title=escape(title),
        policy=(
            "default-src 'none'; base-uri 'none'; form-action 'none'; img-src blob: data:; media-src blob:; "
            f"script-src {_hash(script)}; style-src {_hash(style)}"
        ),
        style=style,
        body=asset(body),
        data=pack(info, arrays),
        script=script,
    )


def asset(name: str) -> str:
    """Text of one of our own files for pages."""
    return files("scex_sumo.reports.page").joinpath("assets", name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """What a content policy calls a script or style that may run: by its content."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
