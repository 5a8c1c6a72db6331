"""Card of critical responses on a run's page: what it takes, a map of the pair, and sliders."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from scex_sumo.page.html import Html, element
from scex_sumo.page.parts import PagePart

SCRIPTS: Final = ("loop.js", "acting.js", "response.js")


def response_part(lines: Sequence[str], file: Path) -> PagePart:
    """Return the card of what it takes.

    Args:
        lines: how often two collide, then the worst pairs in words.
        file: of the maps; without it the card has the words alone.
    """
    maps = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    rows = element("ul", *(element("li", line.strip()) for line in lines[1:]))
    about = "Counted actions, published response times, no steering; see docs/response.md."
    head = element("h2", "What it takes until two collide")
    soft = element("p.soft", f"{lines[0].partition(';')[0].capitalize()}. {about}")
    plot = [_map()] if maps else []
    card = element("section.card", head, soft, *plot, rows, id="response")
    return PagePart(first=[card], info={"responses": maps or None}, scripts=SCRIPTS if maps else ())


def _map() -> Html:
    sliders = element(
        "div",
        _slider("median response time", "median", low=0.4, high=4.0),
        _slider("share that looks away", "away", low=0.0, high=1.0),
        _slider("response time that plays", "late", low=0.0, high=4.5),
        id="people",
    )
    plot = element("canvas", id="response-map", tabindex="0", role="slider", aria_label="Action of the map")
    stage = element("canvas", id="acting", role="img", aria_label="The two vehicles at this point of the map")
    return element(
        "div",
        element("div.scroll", id="response-table"),
        element("div.acting", element("div", plot), stage),
        element("p.soft", id="acting-said"),
        element("p.soft", id="response-said"),
        sliders,
        element("div.row", element("button", "people as counted", id="own-people")),
    )


def _slider(words: str, name: str, *, low: float, high: float) -> Html:
    slider = element("input", type="range", min=str(low), max=str(high), step="any", id=f"people-{name}")
    return element("label.weight", element("span", words), slider, element("output"))
