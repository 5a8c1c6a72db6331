"""``scex-sumo validate``: how well a mix of models forecasts what really happened."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.commands.console import run_study, warn
from scex_sumo.commands.options import Cluster, Every, MinVehicles, Models, Processes, Roots, Seed
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from scex_sumo.studies.validate.validate import Validation


EXAMPLE = "recordings/ --models likely --workers 8 -o out/validation"


def validate_command(
    roots: Roots,
    models: Models = None,
    every: Every = 1.0,
    children: Annotated[int, Option(help="Futures of a seed scene.")] = 96,
    min_vehicles: MinVehicles = 2,
    part: Annotated[
        str, Option(metavar="all|train|validation|test", help="Part of each recording's time.")
    ] = "all",
    seed: Seed = 0,
    workers: Processes = 1,
    cluster: Cluster = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace another validation.")] = False,
    out: Annotated[
        Path, Option("-o", "--out", metavar="OUT", help="Folder; else out/validation.", show_default=False)
    ] = Path("out") / "validation",
) -> Answer:
    """Compare the forecasts of a mix of models with what really happened."""
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


def _print_scores(done: Validation) -> None:
    from rich.markup import escape
    from rich.table import Table

    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.run_table import counted, print_line, print_table
    from scex_sumo.studies.validate.page import collisions_in, printed_name

    info = done.info
    console = output_console(width=140)
    scenes, recordings = counted(info["seeds"], "seed scene"), counted(info["recordings"], "recording")
    print(f"{scenes} of {recordings}, models {', '.join(info['models'])}")
    told = (
        f"mean Brier score of the paper's thresholds {info['mean_brier']:.3f} (0: every forecast right), "
        f"of constant velocity {info['mean_brier_constant_velocity']:.3f}, of the base rate "
        f"{info['mean_brier_base_rate']:.3f}; P(collision) {collisions_in(info)}"
    )
    print_line(told, console)
    about = "skill: 1 perfect, 0 as good as the base rate, the seed moment, constant velocity"
    events = Table(title="events", title_justify="left", caption=about, caption_justify="left")
    pairs = Table(title="pairs of vehicles", title_justify="left")
    for table, name, seed_moment in ((events, "events", ("skill_seed_moment",)), (pairs, "pairs", ())):
        skills = ("skill_base_rate", *seed_moment, "skill_constant_velocity")
        heads = ("skill: base rate", *("seed moment" for _ in seed_moment), "const. vel.")
        for head in ("event", "happened", "forecast", "Brier", "Brier: const. vel.", *heads):
            table.add_column(head, justify="left" if head == "event" else "right")
        for row in done.tables[name].to_pylist():
            shares = [f"{row[key]:.{0 if table is events else 2}%}" for key in ("happened", "forecast")]
            scores = [
                f"{row[key]:.{3 if table is events else 4}f}" for key in ("brier", "brier_constant_velocity")
            ]
            gains = ["–" if row[key] != row[key] else f"{row[key]:.2f}" for key in skills]
            table.add_row(row["event"], *shares, *scores, *gains)
    values = Table(title="values", title_justify="left")
    for name in ("value", "cases", "CRPS skill", "within 5-95 %"):
        values.add_column(name, justify="left" if name == "value" else "right")
    for row in done.tables["values"].to_pylist():
        name, share = escape(printed_name(row["column"])), f"{row['coverage']:.0%}"
        values.add_row(name, str(row["count"]), f"{row['crps_skill']:.2f}", share)
    for each in (events, pairs, values):
        print_table(each, console, breaks=(" base rate", " moment", " vel."))
