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

EXAMPLE = "recordings/ --count 50 -o suite"
_NOTES = 5


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
    """Make a weighted test suite of recordings, or of finished rankings."""
    from scex_sumo.suites.catalogue import PAGE, catalogue

    with progress_bar("futures") as tick, resumable("seeds", out):
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
    notes = list(suite.info["notes"])
    more = [f"{len(notes) - _NOTES} more notes; see suite.json"] if len(notes) > _NOTES else []
    warn(notes[:_NOTES] + more)
    _print_coverage(suite)
    print(f"result: {out / 'suite.json'}")
    print(f"look:   {out / PAGE}")
    print(f"next:   scex-sumo test {out} --under-test my_driver:Driver")
    return lambda: {"result": out / "suite.json", "report": out / PAGE, **suite.info}


def _print_coverage(suite: Suite) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.study import Column, print_columns
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.suites.population import RISK_WORDS

    info, console = suite.info, output_console(width=120)
    rate = {row["kind"]: row for row in info["exposure"]}
    rows = [
        {
            "kind": row["kind"],
            "per_hour": rate[row["kind"]]["per_hour"],
            "people": rate[row["kind"]]["people_collide_per_hour"],
            **{
                word: f"{before} → {after}" if before else ""
                for word, before, after in zip(RISK_WORDS, row["before"], row["after"], strict=True)
            },
        }
        for row in info["coverage"]
    ]
    columns = [
        Column("kind", "kind", "words"),
        Column("per_hour", "an hour", ".1f"),
        Column("people", "people collide an hour", ".1g"),
        *(Column(word, word, "words") for word in RISK_WORDS),
    ]
    print_columns(columns, rows, console, "candidates → cases, by P of people")
    people = info["people"]
    line = (
        f"{len(suite.cases)} cases for {info['candidates']} candidates in {info['encounters']} encounters of "
        f"{info['hours']:.2g} h ({info['doubtful']} encounters with doubtful data left out); people collide "
        f"{people['collisions_per_hour']:.1g} times an hour, severely {people['severe_per_hour']:.1g} times"
    )
    print_line(line, console)
