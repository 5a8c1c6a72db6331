"""``scex-sumo catalogue``: make a weighted test suite of recordings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.console import progress_bar, resumable, warn
from scex_sumo.commands.options import Every, Processes, Roots
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from scex_sumo.suites.suite import Suite

EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm --count 3 -o out/suite"


def catalogue_command(
    roots: Roots,
    count: Annotated[int, Option(help="Cases.")] = 50,
    every: Every = 1.0,
    to: Annotated[
        str, Option(metavar="FORMAT,...", help="Files of each case for simulators; none: no files.")
    ] = "openscenario,commonroad,sumo",
    licence: Annotated[str, Option(metavar="TEXT", help="Sentence on what the recordings allow.")] = "",
    workers: Processes = "auto",
    overwrite: Annotated[bool, Option("--overwrite", help="Replace another suite.")] = False,
    out: Annotated[Path, Option("-o", "--out", metavar="OUT", help="Folder of the suite.")] = Path("suite"),
) -> Answer:
    """Make a weighted test suite of recordings, or of rankings."""
    from scex_sumo.suites.catalogue import PAGE, catalogue

    with progress_bar("cases") as tick, resumable("seeds", out):
        suite = catalogue(
            roots,
            out=out,
            count=count,
            every=every,
            formats=() if to == "none" else tuple(name.strip() for name in to.split(",")),
            licence=licence,
            workers=workers,
            overwrite=overwrite,
            command=["scex-sumo", *sys.argv[1:]],
            progress=tick,
        )
    warn(suite.info["notes"])
    _print_coverage(suite)
    print(f"result: {out / 'suite.json'}")
    print(f"look:   {out / PAGE}")
    print(f"next:   scex-sumo test {out} --under-test my_driver:Driver")
    return lambda: {"result": out / "suite.json", "report": out / PAGE, **suite.info}


def _print_coverage(suite: Suite) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.document import print_columns
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.suites.page import COVERAGE, coverage_rows, population_words

    console = output_console(width=120)
    title = "candidates → cases, by P(contact) of people"
    print_columns(COVERAGE, coverage_rows(suite.info), console, title)
    print_line(population_words(suite.info), console)
