"""``scex-sumo run``: from a map and a moment to a result folder."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.base.options import from_command_line, split_options
from scex_sumo.base.processes import AUTO, read_workers
from scex_sumo.commands.console import output_console, progress_bar, resumable, warn
from scex_sumo.commands.options import MapPath, with_options
from scex_sumo.commands.shared import COMMANDS, Answer
from scex_sumo.extrapolation.options import OUTPUT, RUN_OPTIONS, RunOptions
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.scenarios.seeds import SeedOptions
from scex_sumo.steps.seed import seed_scene

if TYPE_CHECKING:
    from scex_sumo.results.run import Run

Details = Annotated[bool, Option("--details", help="Print all metrics, too.", rich_help_panel=OUTPUT)]

EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm -o out/roundabout"


KINDS = (SeedOptions, *RUN_OPTIONS)


@with_options(KINDS)
def run_command(map_path: MapPath, *, details: Details = False, **given: Any) -> Answer:
    """Simulate futures of one moment: how critical can it become?"""
    own = zip(KINDS, split_options(given, KINDS), strict=True)
    values = [from_command_line(kind, options) for kind, options in own]
    values[2].setdefault("workers", read_workers(os.environ.get("SCEX_WORKERS", AUTO)))
    source, settings = SeedOptions(**values[0]), RunSettings(**values[1])
    options = RunOptions(bar=progress_bar, command=["scex-sumo", *sys.argv[1:]], **values[2])
    with Workers(options.processes(settings)) as pool:
        from scex_sumo.extrapolation.engine import checked_models  # while workers start
        from scex_sumo.steps.moment import run_moment

        models = checked_models(settings, options)
        scene = seed_scene(map_path, source, seed=settings.seed, cache=options.cache)
        folder = Path(options.out) if options.out is not None else Path("out") / scene.name
        options = replace(options, out=folder)
        with resumable("futures", folder):
            run = run_moment(scene, settings, workers=pool, options=options, models=models)
    _tell(run, details=details, every=given["metrics"] is not None)
    if options.gui:
        COMMANDS.load("view")(run.folder)
    return partial(_answer, run)


def _answer(run: Run) -> dict[str, Any]:
    from scex_sumo.steps.answers import run_answer

    return run_answer(run)


def _tell(run: Run, *, details: bool, every: bool) -> None:
    from scex_sumo.reports.card import print_card, print_closing

    warn([*run.info["net_notes"], *run.info["run_notes"]])
    console = output_console(width=80)
    if run.info.get("under_test") and run.baseline is not None:
        from scex_sumo.reports.under_test import print_under_test

        print_under_test(run, console, every=every)
    print_card(run, console)
    if details or every:
        from scex_sumo.reports.run_table import print_details

        print_details(run, output_console(width=110), every=every)
    for what, path in {"result": run.folder, **run.written}.items():
        if what != "result" or "report" not in run.written:
            print(f"{what + ':':<7} {path}")
    print(
        f"look:   scex-sumo view {shlex.quote(str(run.folder))}{'' if details else '      more: --details'}"
    )
    print_closing(run, console)
