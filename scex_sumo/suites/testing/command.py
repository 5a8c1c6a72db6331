"""``scex-sumo test``: a driving function on a suite, with a verdict for continuous integration."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from scex_sumo.commands.console import progress_bar, resumable
from scex_sumo.commands.options import AnyWorkers
from scex_sumo.commands.shared import Answer

EXAMPLE = 'suite --under-test my_driver:Driver --fail-if "worse > 0" --junit out/junit.xml'


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
        str | None, Option(metavar="FILE|NAME,...", help="Cases: a list saved on the page, or names.")
    ] = None,
    fail_if: Annotated[
        list[str] | None,
        Option("--fail-if", metavar="COND", help="End with status 1 if it holds, e.g. 'worse > 0'."),
    ] = None,
    junit: Annotated[Path | None, Option(metavar="FILE", help="Write JUnit XML.")] = None,
    against: Annotated[
        Path | None, Option(metavar="JSON", help="test.json of another or an older function.")
    ] = None,
    workers: AnyWorkers = "auto",
    overwrite: Annotated[bool, Option("--overwrite", help="Replace another test.")] = False,
    out: Annotated[
        Path, Option("-o", "--out", metavar="OUT", help="Folder; else out/test.", show_default=False)
    ] = Path("out") / "test",
) -> Answer:
    """Test a driving function on a suite: better or worse than people, and collisions an hour."""
    from scex_sumo.base.errors import ScexError
    from scex_sumo.suites.testing.result import Condition
    from scex_sumo.suites.testing.suite_test import PAGE, RESULT, SUMMARY, test_suite

    conditions = [(text, Condition.of(text)) for text in fail_if or ()]
    with progress_bar("cases") as tick, resumable("cases", out):
        done = test_suite(
            suite,
            under_test,
            out=out,
            futures=futures,
            cases=None if cases is None else _names(cases),
            workers=workers,
            against=against,
            junit=junit,
            overwrite=overwrite,
            command=["scex-sumo", *sys.argv[1:]],
            progress=tick,
        )
    _print_result(done.result)
    print(f"result: {out / RESULT}, {out / SUMMARY}")
    print(f"look:   {out / PAGE}")
    failed = [
        f"{text} (it is {one.value(done.result):g})" for text, one in conditions if one.holds(done.result)
    ]
    reason = f"fails by --fail-if {', '.join(failed)}" if failed else ""
    if not failed and done.result["number"] is None:
        reason = "every case failed; the reasons stand above"
    answer = {"report": out / PAGE, **done.result}
    if reason:
        error = ScexError(f"{under_test}: {reason}")
        error.answer = answer
        raise error
    return lambda: answer


def _names(given: str) -> list[str]:
    from scex_sumo.base.errors import UsageError

    if Path(given).is_file():
        try:
            return Path(given).read_text(encoding="utf-8").split()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"--cases {given}: cannot be read: {error}") from None
    return [name.strip() for name in given.split(",")]


def _print_result(result: Mapping[str, Any]) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.study import Column, print_columns
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.suites.testing.outputs import case_words, number_lines
    from scex_sumo.suites.testing.result import FAILED, VERDICTS, WORSE, verdicts_by_kind

    console, cases = output_console(width=120), result["cases"]
    rows = [
        {"kind": kind, **{name: count or None for name, count in counts.items()}}
        for kind, counts in verdicts_by_kind(cases).items()
    ]
    columns = [Column("kind", "kind", "words"), *(Column(name, name, ".0f") for name in VERDICTS)]
    print_columns(columns, rows, console, f"{result['function']}: cases, against people")
    for one in cases:
        if one["verdict"] in (WORSE, FAILED):
            print_line(f"  {one['name']}: {case_words(one)}", console)
    for line in number_lines(result):
        print_line(line, console)
    print_line(f"cannot see: {'; '.join(result['unseen'])}", console)
    if change := result.get("against"):
        words = (
            f"{len(change[name])} {name.replace('_', ' ')}" for name in ("became_better", "became_worse")
        )
        print_line(f"against {change['function']}: {', '.join(words)}, {change['same']} the same", console)
