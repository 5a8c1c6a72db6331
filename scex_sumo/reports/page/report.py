"""Report of a run: ``report.html`` in its result folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scex_sumo.base.files import write_atomic
from scex_sumo.reports.page.body import run_body
from scex_sumo.reports.page.contents import report_contents
from scex_sumo.reports.page.exact import exact_card, exact_contents
from scex_sumo.reports.page.html import BASE, page_html
from scex_sumo.reports.page.study import table
from scex_sumo.reports.page.under_test import TABLE, under_test_card
from scex_sumo.reports.under_test_table import HEADS, under_test_rows
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene

REPORT = "report.html"
SCRIPTS = (
    *BASE,
    *("state.js", "chart.js", "pairs.js", "map.js", "player.js", "models.js"),
    *("selection.js", "address.js", "vehicles.js", "exact.js", "parts.js", "report.js"),
)


def write_report(run: Run, scene: SeedScene | None = None) -> Path:
    """Write the report of a finished run into its folder and return its path."""
    path = run.folder / REPORT
    write_atomic(path, report_html(run, scene).encode())
    return path


def report_html(run: Run, scene: SeedScene | None = None) -> str:
    """Return the report of a run as HTML."""
    return filled_report(run, *report_contents(run, scene))


def filled_report(run: Run, info: dict[str, Any], arrays: dict[str, Any]) -> str:
    """Return the report as HTML from the result of `report_contents`."""
    is_tested = run.baseline is not None and run.info.get("under_test")
    tables = {TABLE: table(HEADS, under_test_rows(run.under_test))} if is_tested else {}
    body = run_body(info, under_test_card(run), *exact_card(run))
    more = {"tables": tables, "exact": exact_contents(run)}
    return page_html(info["name"], body, SCRIPTS, info | more, arrays)
