"""HTML of runs and seed scenes in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scex_sumo.results.run import Run
    from scex_sumo.scene import SeedScene

_HEIGHT_PX = 900


def run_html(run: Run) -> str:
    """Return the report of a run in a frame."""
    from scex_sumo.page.html import element
    from scex_sumo.page.report.report import report_html

    # The sandbox keeps the report's script from the notebook.
    return element(
        "iframe", srcdoc=report_html(run), sandbox="allow-scripts", width="100%", height=_HEIGHT_PX
    )


def scene_html(scene: SeedScene) -> str:
    """Return a table of the vehicles of a seed scene."""
    import numpy as np

    from scex_sumo.page.html import element, plain_table

    now = scene.now
    heads = ("track", "type", "x [m]", "y [m]", "speed [m/s]", "heading [°]", "length [m]", "width [m]")
    columns = (now.x, now.y, now.speed, np.degrees(now.heading), scene.length, scene.width)
    table = [
        [str(track), kind, *(f"{column[v]:.1f}" for column in columns)]
        for v, (track, kind) in enumerate(zip(scene.track_ids, scene.types, strict=True))
    ]
    return element("div", element("p", repr(scene)), plain_table(heads, table))
