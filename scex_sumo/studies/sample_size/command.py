"""``scex-sumo sample-size``: how many futures are enough, with all assignments as the truth."""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from scex_sumo.base.errors import UsageError
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.metrics import write_table
from scex_sumo.commands.options import (
    Case,
    MapPath,
    Origin,
    Overwrite,
    Preset,
    Processes,
    ResultPath,
    Seed,
    Synthetic,
    Time,
    Tracks,
)
from scex_sumo.commands.seed import seed_scene

if TYPE_CHECKING:
    from rich.table import Table

    from scex_sumo.results.run import Run


MAX_DRAWS = 100_000


EXAMPLE = "roundabout.osm -o out/enough"


def sample_size_command(
    map_path: MapPath,
    tracks: Tracks = None,
    case: Case = None,
    time: Time = None,
    synthetic: Synthetic = None,
    origin: Origin = None,
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
    workers: Processes = 1,
    plots: Annotated[
        bool, Option("--report/--no-report", "--plots/--no-plots", help="Write sample_size.html.")
    ] = True,
    overwrite: Overwrite = False,
    out: ResultPath = None,
) -> None:
    """Run all assignments of a small scene, and show how few are enough."""
    import pyarrow as pa

    from scex_sumo.commands.console import output_console
    from scex_sumo.reports.run_table import print_line
    from scex_sumo.studies.sample_size.reduction import choose_vehicles, reduced
    from scex_sumo.studies.sample_size.sample_size import MODELS, study, subsets, truth

    wanted = _sizes(sizes)
    if not 1 <= draws <= MAX_DRAWS:
        raise UsageError(f"--draws: got {draws:,}, needs 1 to {MAX_DRAWS:,}")
    whole = seed_scene(
        map_path, tracks=tracks, case=case, time=time, synthetic=synthetic, origin=origin, seed=seed
    )
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
    console.print(_table(rows, run, draws))
    for line in _answers(rows):
        print_line(line, console)
    print(
        f"all {run.children} assignments: {simulated - started:.0f} s; "
        f"samples: {clock.perf_counter() - simulated:.0f} s"
    )
    print(f"result: {folder / 'sample_size.csv'}")
    if plots:
        from scex_sumo.studies.sample_size.page import HTML, write_sample_size

        one = {n: subsets(run.children, n, 1, seed=seed)[0] for n in wanted if n <= run.children}
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


def _table(rows: list[dict[str, Any]], run: Run, draws: int) -> Table:
    from rich.table import Table

    scene = run.info["seed_scene"]
    table = Table(
        title=f"{scene['name']}: samples of {run.children} assignments, {draws} draws each",
        title_justify="left",
        caption="from all assignments, median and 95 % of the samples: KS largest difference of a share of "
        "futures, W1 in the metric's unit, JSD 0 to 1",
        caption_justify="left",
    )
    for name in ("metric", "design"):
        table.add_column(name, no_wrap=True)
    for name in ("runs", "KS", "95 %", "W1", "95 %", "JSD", "95 %"):
        table.add_column(name, justify="right", no_wrap=True)
    last = None
    for row in rows:
        if row["metric"].endswith("_mean"):
            continue
        if last not in (None, row["metric"]):
            table.add_section()
        distances = [row[f"{d}_{q}"] for d in ("ks", "w1", "jsd") for q in ("median", "p95")]
        shown = ["–" if d is None else f"{d:.3f}" for d in distances]
        table.add_row(row["metric"] if row["metric"] != last else "", row["design"], str(row["size"]), *shown)
        last = row["metric"]
    return table
