"""``scex-sumo catalogue``: make a weighted test suite of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.options import Every, OutFolder, Overwrite, Processes, Roots
from scex_sumo.commands.shared import Answer
from scex_sumo.studies.moments.command import run_study

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
    workers: Processes = "auto",
    overwrite: Overwrite = False,
    out: OutFolder = Path("suite"),
) -> Answer:
    """Make a weighted test suite of recordings, or of rankings."""
    options = {**locals()}
    from scex_sumo.suites.catalogue import PAGE, catalogue

    names = options.pop("to")
    options["formats"] = () if names == "none" else tuple(name.strip() for name in names.split(","))
    suite = run_study(catalogue, "cases", **options)
    _print_coverage(suite)
    print(f"result: {out / 'suite.json'}")
    print(f"look:   {out / PAGE}")
    print(f"next:   scex-sumo test {out} --under-test my_driver:Driver")
    return lambda: {"result": out / "suite.json", "report": out / PAGE, **suite.info}


def _print_coverage(suite: Suite) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.columns import print_columns
    from scex_sumo.reports.console_table import print_line
    from scex_sumo.suites.page import COVERAGE, population_words

    console = output_console(width=120)
    print_columns(COVERAGE, suite.info["exposure"], console, "candidates and cases")
    print_line(population_words(suite.info), console)
