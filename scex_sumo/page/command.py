"""``scex-sumo report``: the page of a result folder, written again."""

from __future__ import annotations

from scex_sumo.commands.options import Result

EXAMPLE = "out/roundabout"


def report_command(folder: Result) -> None:
    """Write report.html of a result folder again."""
    from scex_sumo.page.report.report import write_report
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    with as_written(folder):
        path = write_report(open_run(folder))
    print(path)
