"""``scex-sumo validate``: how well a mix of models forecasts what really happened."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Every, OutFolder, Overwrite, Processes, Roots
from scex_sumo.commands.shared import Answer
from scex_sumo.studies.moments.command import Models, run_study

if TYPE_CHECKING:
    from scex_sumo.studies.validate.validate import Validation


EXAMPLE = "scex_sumo/scenarios/data --every 5 -o out/validation"


def validate_command(
    roots: Roots,
    models: Models = None,
    every: Every = 1.0,
    futures: Annotated[int, Option(help="Futures of a seed scene.")] = 96,
    part: Annotated[
        str, Option(metavar="all|train|validation|test", help="Part of each recording's time.")
    ] = "all",
    steps: Annotated[int, Option(help="Steps of 0.1 s of a future: 30, or 50, 80.")] = 30,
    workers: Processes = "auto",
    overwrite: Overwrite = False,
    out: OutFolder = Path("out") / "validation",
) -> Answer:
    """Compare forecasts of models with what really happened."""
    options = {**locals(), "models": "likely" if models is None else models}
    from scex_sumo.studies.validate.validate import validate

    done = run_study(validate, "seeds", **options)
    warn([f"{name}: failed: {reason}" for name, reason in list(done.info["failed"].items())[:5]])
    _print_scores(done)
    print(f"result: {out / 'events.parquet'}")
    print(f"look:   {out / 'validation.html'}")
    known = ("models", "recordings", "seeds", "mean_brier", "mean_brier_base_rate", "notes", "failed")
    return lambda: {
        "result": out / "events.parquet",
        "report": out / "validation.html",
        **{name: done.info[name] for name in known},
        **{name: table.to_pylist() for name, table in done.tables.items()},
    }


_PAGE_ONLY = ("uncertainty", "brier_low", "brier_high", "mean_error_m", "least_error_m")
"""Cells that the page has: without them, the tables fit into 80 columns."""


def _print_scores(done: Validation) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.page.columns import print_columns
    from scex_sumo.reports.console_table import print_line
    from scex_sumo.reports.words import counted
    from scex_sumo.studies.validate.page import EVENT_COLUMNS, POSITION_COLUMNS, collisions_in

    info = done.info
    console = output_console(width=140)
    scenes, recordings = counted(info["seeds"], "seed scene"), counted(info["recordings"], "recording")
    print(f"{scenes} of {recordings}, models {', '.join(info['models'])}")
    scores = (
        f"mean Brier score of the paper's thresholds {info['mean_brier']:.3f} (0: every forecast right), "
        f"of constant velocity {info['mean_brier_constant_velocity']:.3f}, of the base rate "
        f"{info['mean_brier_base_rate']:.3f}; P(collision) {collisions_in(info)}"
    )
    print_line(scores, console)

    about = "better: 1 perfect, 0 no better, below 0 worse; the page has more, pairs and values"
    breaks = (" velocity", " base rate", " within", " constant")
    titles = {"events": about, "positions": "distance of the futures from the recorded places, m"}
    forms = {"real": ".3f", "metres": ".2f", "percent": ".0%"}
    for (name, words), columns in zip(titles.items(), (EVENT_COLUMNS, POSITION_COLUMNS), strict=True):
        shown = [column for column in columns if column.cell not in _PAGE_ONLY]
        printed = [column._replace(form=forms.get(column.form, column.form)) for column in shown]
        print_columns(printed, done.tables[name].to_pylist(), console, name, words, breaks=breaks)
