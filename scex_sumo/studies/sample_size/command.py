"""``scex-sumo sample-size``: how many futures are enough, with all assignments as the truth."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import from_command_line
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.generated import with_options
from scex_sumo.commands.options import (
    Overwrite,
    Preset,
    Processes,
    ResultPath,
    Seed,
)
from scex_sumo.commands.seed import MapPath, seed_scene
from scex_sumo.commands.tables import write_table
from scex_sumo.scenarios.options import SeedOptions

if TYPE_CHECKING:
    from rich.console import Console

    from scex_sumo.results.run import Run


MAX_DRAWS = 100_000


EXAMPLE = "roundabout.osm -o out/enough"


@with_options(lambda: (SeedOptions,))
def sample_size_command(
    map_path: MapPath,
    vehicles: Annotated[int, Option(help="Number of vehicles that take part, nearest to each other.")] = 5,
    models: Annotated[
        str | None, Option(metavar="MODEL,...", help="Models; default: six, as in the paper's study.")
    ] = None,
    sizes: Annotated[str, Option(metavar="N,...", help="Sizes of the samples.")] = "1000,385,100,10",
    draws: Annotated[int, Option(help="Samples of each size.")] = 200,
    designs: Annotated[
        str, Option(metavar="NAME,...", help="random: subsets; balanced: as --design of run.")
    ] = "random",
    preset: Preset = "both",
    seed: Seed = 0,
    workers: Processes = "auto",
    plots: Annotated[
        bool, Option("--report/--no-report", "--plots/--no-plots", help="Write sample_size.html.")
    ] = True,
    overwrite: Overwrite = False,
    out: ResultPath = None,
    **given: Any,
) -> None:
    """Run all assignments of a small scene, and show how few are enough."""
    import pyarrow as pa

    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.studies.sample_size.sample_size import (
        MODELS,
        choose_vehicles,
        reduced,
        study,
        subsets,
        truth,
    )

    wanted = _sizes(sizes)
    if not 1 <= draws <= MAX_DRAWS:
        raise UsageError(f"--draws: got {draws:,}, needs 1 to {MAX_DRAWS:,}")
    whole = seed_scene(map_path, SeedOptions(**from_command_line(SeedOptions, given)), seed=seed)
    scene = reduced(whole, choose_vehicles(whole, vehicles))
    if scene.vehicles < whole.vehicles:
        kept = ", ".join(str(t) for t in scene.track_ids)
        warn(
            [f"{scene.vehicles} of {whole.vehicles} vehicles take part, those nearest to each other: {kept}"]
        )
    folder = out if out is not None else Path("out") / f"{scene.name}_sample_size"
    started = clock.perf_counter()
    with progress_bar(f"{scene.name}: all assignments") as tick:
        run = truth(
            scene,
            folder,
            models=models if models is not None else MODELS,
            preset=preset,
            seed=seed,
            workers=workers,
            overwrite=overwrite,
            command=["scex-sumo", *sys.argv[1:]],
            progress=tick,
        )
    simulated = clock.perf_counter()
    names = [d.strip() for d in designs.split(",") if d.strip()]
    with progress_bar("samples") as tick:
        rows = study(run, sizes=wanted, draws=draws, designs=names, seed=seed, progress=tick)
    table = pa.Table.from_pylist(rows)
    for name in ("sample_size.parquet", "sample_size.csv"):
        write_table(table, folder / name)
    console = output_console(width=110)
    _print(rows, run, draws, console)
    for line in _answers(rows):
        print_line(line, console)
    print(
        f"all {run.futures} assignments: {simulated - started:.0f} s; "
        f"samples: {clock.perf_counter() - simulated:.0f} s"
    )
    print(f"result: {folder / 'sample_size.csv'}")
    if plots:
        from scex_sumo.studies.sample_size.page import HTML, write_sample_size

        one = {n: subsets(run.futures, n, 1, seed=seed)[0] for n in wanted if n <= run.futures}
        print(f"report: {write_sample_size(run, rows, one, folder / HTML)}")


def _sizes(text: str) -> tuple[int, ...]:
    parts = [p.strip() for p in text.split(",") if p.strip()]
    if not parts or not all(p.isdigit() and int(p) > 0 for p in parts):
        raise UsageError(f"--sizes {text}: needs whole numbers above 0, e.g. 1000,385,100,10")
    return tuple(int(p) for p in parts)


def _answers(rows: list[dict[str, Any]]) -> Iterator[str]:
    from numpy import median

    for design, size in dict.fromkeys((row["design"], row["size"]) for row in rows):
        part = [row for row in rows if (row["design"], row["size"]) == (design, size)]
        if ks := {row["metric"]: row["ks_p95"] for row in part if row["ks_p95"] is not None}:
            worst = max(ks, key=ks.__getitem__)
            yield (
                f"{size} futures, {design}: 95 % of samples have shares right within "
                f"{median([*ks.values()]):.2f}; {worst} within {ks[worst]:.2f}"
            )


def _print(rows: list[dict[str, Any]], run: Run, draws: int, console: Console) -> None:
    from scex_sumo.page.study import Column, print_columns
    from scex_sumo.studies.sample_size.page import COLUMNS

    about = (
        "from all assignments, median and 95 % of the samples: KS largest difference of a share of "
        "futures, W1 in the metric's unit, JSD 0 to 1"
    )
    names = ("KS", "95 %", "W1", "95 %", "JSD", "95 %")
    distances = [one._replace(title=name, form=".3f") for name, one in zip(names, COLUMNS[3:], strict=True)]
    heads = [Column("metric", "metric", "words"), Column("design", "design", "words"), Column("size", "runs")]
    title = f"{run.info['seed_scene']['name']}: samples of {run.futures} assignments, {draws} draws each"
    shown = [row for row in rows if not row["metric"].endswith("_mean")]
    print_columns([*heads, *distances], shown, console, title, about, grouped=True)
