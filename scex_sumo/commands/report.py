"""``scex-sumo report``: the page of a result folder, written again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(folder: Annotated[Path, typer.Argument(metavar="OUT", help="Result folder.")]) -> None:
    """Write report.html of a result folder again: all that is in it, to look at in a browser."""
    from scex_sumo.reports.page.report import write_report
    from scex_sumo.results.run import open_run

    print(write_report(open_run(folder)))
