"""``scex-sumo plot``: figures of result folders for a paper; P of several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scex_sumo.base.errors import ResultError, UsageError

if TYPE_CHECKING:
    from scex_sumo.results.run import Run

CURVES = ("density", "cumulative")
ENDINGS = (".svg", ".png", ".pdf")
EXAMPLE = "out/roundabout --metric ttc -o out/ttc.svg"


def plot_command(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="OUT...", help="Result folders; several share their axes.", show_default=False
        ),
    ],
    metric: Annotated[
        str | None, typer.Option(metavar="METRIC", help="One metric only; else all of them.")
    ] = None,
    curve: Annotated[str, typer.Option(metavar="|".join(CURVES), help="What is drawn.")] = "density",
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", metavar="FILE", help=f"FILE{'|'.join(ENDINGS)}; else CURVE.svg in the first OUT."
        ),
    ] = None,
) -> None:
    """Draw densities of results; print P of several side by side."""
    if curve not in CURVES:
        raise UsageError(f"--curve {curve}: unknown curve; known: {', '.join(CURVES)}")
    path = out if out is not None else folders[0] / f"{curve}.svg"
    if path.suffix not in ENDINGS:
        raise UsageError(f"-o {path}: unknown ending; known: {', '.join(ENDINGS)}")
    from scex_sumo.page.figures.figure import plot
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    labels = short_names(folders) if len(folders) > 1 else ["stress test"]
    with as_written(*folders):
        runs = [open_run(folder) for folder in folders]
        check_comparable(runs, labels)
        plot(runs, path, metric=metric, curve=curve, labels=labels)
        if len(runs) > 1:
            _print_probabilities(runs, labels)
    print(path)


def short_names(folders: Sequence[Path]) -> list[str]:
    """Return the last, different parts of paths; raise a `UsageError` for a folder that is named twice."""
    paths = [folder.resolve().parts for folder in folders]
    for depth in range(1, max(len(path) for path in paths) + 1):
        names = ["/".join(path[-depth:]) for path in paths]
        if len(set(names)) == len(names):
            return names
    raise UsageError("plot: a result folder is named twice; name every result once")


def check_comparable(runs: Sequence[Run], labels: Sequence[str]) -> None:
    """Raise a `ResultError` if runs differ in length, metrics or thresholds."""
    for label, run in zip(labels[1:], runs[1:], strict=True):
        for what, own, first in (
            ("steps in a future", run.info["steps"], runs[0].info["steps"]),
            ("metrics", _metrics(run), _metrics(runs[0])),
            ("thresholds", run.thresholds, runs[0].thresholds),
        ):
            if own != first:
                raise ResultError(
                    f"{label}: {what} {own}, but {labels[0]} has {first}; run one of them again as the other"
                )


def _metrics(run: Run) -> str:
    return ", ".join(f"{column} {run.metric(column).sign}" for column in sorted(run.columns))


def _print_probabilities(runs: Sequence[Run], labels: Sequence[str]) -> None:
    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.console_table import console_table, print_table

    rows: list[Sequence[str]] = [["futures", *(str(run.futures) for run in runs)]]
    rows.append(["collision", *(run.collision.percent for run in runs)])
    humans = [run.reference for run in runs]
    if any(humans):
        shares = (human.collision.percent if human else "–" for human in humans)
        rows.append(["collision, human-like", *shares])
    for column, limit in runs[0].thresholds.items():
        metric = runs[0].metric(column)
        words = f"{metric.words} {metric.sign} {limit:.3g} {metric.column_unit}".rstrip()
        rows.append([words, *(_critical(run, column) for run in runs)])
    heads = [("", "names", ""), *((label, "text", "") for label in labels)]
    caption = "95 % interval in brackets; *: critical in the recorded future, too"
    table = console_table("Share of the futures", heads, rows, caption=caption)
    print_table(table, output_console(width=110))


def _critical(run: Run, column: str) -> str:
    """Return P of a threshold with its interval, and a star if the recorded future passes it."""
    import numpy as np

    from scex_sumo.results.design import is_critical

    recorded, limit = run.recorded_value(column), run.thresholds[column]
    star = recorded is not None and is_critical(np.array([recorded]), run.metric(column), limit)[0]
    return f"{run.p_critical(column).percent}{'*' if star else ''}"
