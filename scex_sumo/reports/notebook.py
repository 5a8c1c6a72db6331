"""Notebook views: runs and seed scenes as HTML inside of a notebook."""

from __future__ import annotations

import numpy as np

from scex_sumo.reports.page.html import Html, element
from scex_sumo.reports.page.report import report_html
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene

_HEIGHT_PX = 900


def run_html(run: Run) -> str:
    """The report of a run, in a frame of its own."""
    # A frame of another origin: the report's script cannot reach the notebook.
    return element(
        "iframe", srcdoc=report_html(run), sandbox="allow-scripts", width="100%", height=_HEIGHT_PX
    )


def scene_html(scene: SeedScene) -> str:
    """A table of the vehicles of a seed scene: who is where, how fast."""
    now = scene.now
    heads = ("track", "type", "x [m]", "y [m]", "speed [m/s]", "heading [°]", "length [m]", "width [m]")
    columns = (now.x, now.y, now.speed, np.degrees(now.heading), scene.length, scene.width)
    rows = [
        element("tr", *_cells([str(track), kind, *(f"{column[v]:.1f}" for column in columns)]))
        for v, (track, kind) in enumerate(zip(scene.track_ids, scene.types, strict=True))
    ]
    head = element("tr", *(element("th", name) for name in heads))
    return element("div", element("p", repr(scene)), element("table", head, *rows))


def _cells(words: list[str]) -> list[Html]:
    return [element("td", word) for word in words]
