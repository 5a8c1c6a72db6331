"""``scex-sumo report``: the page of a result folder, written again."""

from __future__ import annotations

from typing import Annotated, Final

from typer import Option

from scex_sumo.base.importing import Registry
from scex_sumo.commands.options import Result

SHEETS: Final = Registry(group="scex_sumo.sheets", kind="sheet")
"""Functions that write a page about a run into its folder and return its path."""
EXAMPLE = "out/k733"


def report_command(
    folder: Result,
    evidence: Annotated[bool, Option("--evidence", help="Write evidence.html instead: one A4 page.")] = False,
) -> None:
    """Write report.html of a result folder again, or its evidence sheet."""
    from scex_sumo.page.report.report import write_report
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    with as_written(folder):
        path = (SHEETS.load("evidence") if evidence else write_report)(open_run(folder))
    print(path)
