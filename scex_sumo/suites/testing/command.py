"""``scex-sumo test``: a driving function on a suite, with a verdict for continuous integration."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from scex_sumo.commands.console import progress_bar, resumable
from scex_sumo.commands.options import OutFolder, Overwrite, Processes
from scex_sumo.commands.shared import Answer

EXAMPLE = "out/suite --under-test standard_driver"


def test_command(
    suite: Annotated[Path, Argument(help="Folder of a suite.", show_default=False)],
    under_test: Annotated[
        str,
        Option(
            "--under-test", metavar="MODEL", help="Driving function: package.module:Class, a file, a name."
        ),
    ],
    futures: Annotated[int | None, Option(help="Futures of a case; else those of the suite.")] = None,
    cases: Annotated[
        str | None, Option(metavar="NAME,...", help="These cases alone; the page has their names.")
    ] = None,
    fail_if: Annotated[
        list[str] | None,
        Option("--fail-if", metavar="COND", help="End with status 1 if it holds, e.g. 'worse > 0'."),
    ] = None,
    junit: Annotated[Path | None, Option(metavar="FILE", help="Write JUnit XML.")] = None,
    against: Annotated[
        Path | None, Option(metavar="JSON", help="test.json of another or an older function.")
    ] = None,
    workers: Processes = "auto",
    overwrite: Overwrite = False,
    out: OutFolder = Path("out") / "test",
) -> Answer:
    """Test a driving function on a suite: better or worse than people."""
    from scex_sumo.base.errors import ScexError
    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.console_table import print_line
    from scex_sumo.suites.testing.result import holding, read_condition, summary_lines, title
    from scex_sumo.suites.testing.suite_test import PAGE, RESULT, SUMMARY, test_suite

    conditions = [read_condition(text) for text in fail_if or ()]
    with progress_bar("cases") as tick, resumable("cases", out):
        done = test_suite(
            suite,
            under_test,
            out=out,
            futures=futures,
            cases=None if cases is None else [name.strip() for name in cases.split(",")],
            workers=workers,
            against=against,
            junit=junit,
            overwrite=overwrite,
            command=["scex-sumo", *sys.argv[1:]],
            progress=tick,
        )
    print(title(done.result))
    for line in summary_lines(done.result):
        print_line(f"  {line}", output_console(width=120))
    print(f"result: {out / RESULT}, {out / SUMMARY}")
    print(f"look:   {out / PAGE}")
    failed = [words for condition in conditions if (words := holding(condition, done.result))]
    reason = f"fails by --fail-if {', '.join(failed)}" if failed else ""
    if not failed and done.result["number"] is None:
        reason = "every case failed; the reasons stand above"
    answer = {"report": out / PAGE, **done.result}
    if reason:
        error = ScexError(f"{under_test}: {reason}")
        error.answer = answer
        raise error
    return lambda: answer
