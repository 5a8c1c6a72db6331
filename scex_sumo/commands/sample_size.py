"""``scex-sumo sample-size``: how many children are enough, against all assignments as the truth."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.metrics import write_table
from scex_sumo.commands.seed import SeedRequest, seed_scene
from scex_sumo.errors import UsageError

if TYPE_CHECKING:
    from rich.table import Table

    from scex_sumo.results.run import Run


@dataclass(frozen=True, kw_only=True)
class StudyRequest(SeedRequest):
    """The options of ``scex-sumo sample-size`` as given; see its help."""

    vehicles: int
    models: str | None
    sizes: str
    draws: int
    designs: str
    workers: int
    plots: bool
    overwrite: bool
    out: Path | None


def sample_size_command(request: StudyRequest) -> None:
    """Run all assignments, compare samples with them, print the table, write it and draw it."""
    import pyarrow as pa
    from rich.console import Console

    from scex_sumo.scenarios.reduction import choose_vehicles, reduced
    from scex_sumo.studies.sample_size import MODELS, study, subsets, truth

    sizes = _sizes(request.sizes)
    designs = [d.strip() for d in request.designs.split(",") if d.strip()]
    if request.draws < 1:
        raise UsageError(f"--draws: got {request.draws}, needs at least 1")
    whole = seed_scene(request)
    scene = reduced(whole, choose_vehicles(whole, request.vehicles))
    if scene.vehicles < whole.vehicles:
        kept = ", ".join(str(t) for t in scene.track_ids)
        warn(
            [f"{scene.vehicles} of {whole.vehicles} vehicles take part, those nearest to each other: {kept}"]
        )
    out = request.out if request.out is not None else Path("out") / f"{scene.name}_sample_size"
    started = time.perf_counter()
    with progress_bar(f"{scene.name}: all assignments") as tick:
        run = truth(
            scene,
            out,
            models=request.models if request.models is not None else MODELS,
            seed=request.seed,
            workers=request.workers,
            overwrite=request.overwrite,
            command=["scex-sumo", *sys.argv[1:]],
            progress=tick,
        )
    simulated = time.perf_counter()
    with progress_bar("samples") as tick:
        rows = study(run, sizes=sizes, draws=request.draws, designs=designs, seed=request.seed, progress=tick)
    table = pa.Table.from_pylist(rows)
    for name in ("sample_size.parquet", "sample_size.csv"):
        write_table(table, out / name)
    Console(width=None if sys.stdout.isatty() else 110).print(_table(rows, run, request.draws))
    if request.plots:
        from scex_sumo.reports.statistics_pictures import draw_errors, draw_subsets

        one = {n: subsets(run.children, n, 1, seed=request.seed)[0] for n in sizes if n <= run.children}
        draw_subsets(run, one, out / "sample_size")
        draw_errors(rows, run, out / "sample_size_error")
    print(
        f"all {run.children} assignments: {simulated - started:.0f} s; "
        f"samples: {time.perf_counter() - simulated:.0f} s"
    )
    print(f"result: {out / 'sample_size.csv'}")


def _sizes(text: str) -> tuple[int, ...]:
    parts = [p.strip() for p in text.split(",") if p.strip()]
    if not parts or not all(p.isdigit() and int(p) > 0 for p in parts):
        raise UsageError(f"--sizes {text}: needs whole numbers above 0, e.g. 1000,385,100,10")
    return tuple(int(p) for p in parts)


def _table(rows: list[dict[str, Any]], run: Run, draws: int) -> Table:
    from rich.table import Table

    scene = run.info["seed_scene"]
    table = Table(
        title=f"{scene['name']}: samples of {run.children} assignments, {draws} draws each",
        title_justify="left",
        caption="distance of a sample to all assignments: median, 95th percentile; "
        "means of scenes: see the file",
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
