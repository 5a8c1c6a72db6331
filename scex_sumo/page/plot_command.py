"""``scex-sumo plot``: figures of a result folder for a paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.options import Result, metric_option

CURVES = ("density", "cumulative")
ENDINGS = (".svg", ".png", ".pdf")
EXAMPLE = "out/k733 --metric ttc -o ttc.svg"


def plot_command(
    folder: Result,
    metric: Annotated[str | None, metric_option("One metric only; else all of them.")] = None,
    curve: Annotated[str, typer.Option(metavar="|".join(CURVES), help="What is drawn.")] = "density",
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help=f"FILE{'|'.join(ENDINGS)}; else CURVE.svg in OUT."),
    ] = None,
) -> None:
    """Draw the densities of a result as in a paper."""
    if curve not in CURVES:
        raise UsageError(f"--curve {curve}: unknown curve; known: {', '.join(CURVES)}")
    path = out if out is not None else folder / f"{curve}.svg"
    if path.suffix not in ENDINGS:
        raise UsageError(f"-o {path}: unknown ending; known: {', '.join(ENDINGS)}")
    from scex_sumo.page.figures.figure import draw_figure
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    with as_written(folder):
        draw_figure(open_run(folder), curve, path, metric=metric)
    print(path)
