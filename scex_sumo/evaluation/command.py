"""``scex-sumo metrics``: criticality metrics of a recording, a file of cases or a result folder."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from scex_sumo.base.errors import UsageError
from scex_sumo.base.outputs import TABLE_SUFFIXES, write_csv, write_table
from scex_sumo.commands.console import warn

EXAMPLE = "scex_sumo/scenarios/data/roundabout.csv --level scene"


def metrics_command(
    source: Annotated[
        Path, Argument(metavar="TRACKS|OUT", help="Tracks in INTERACTION format, or a result folder.")
    ],
    level: Annotated[str, Option(metavar="pair|scene|scenario", help="Rows.")] = "scenario",
    metrics: Annotated[
        str | None,
        Option(
            "--metrics",
            "--preset",
            metavar="paper|path|both|conflicts|NAME,...",
            help="Metrics; default: the paper's six, or those of the run in OUT.",
        ),
    ] = None,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="FILE", help="FILE.parquet or .csv; else CSV here.")
    ] = None,
) -> None:
    """Evaluate criticality metrics of recorded or simulated tracks."""
    from scex_sumo.evaluation.sources import read_source
    from scex_sumo.evaluation.tables import recording_table
    from scex_sumo.metrics.registry import SETS, metrics_asked
    from scex_sumo.results.info import as_written

    if out is not None and out.suffix not in TABLE_SUFFIXES:
        raise UsageError(f"-o {out}: unknown format {out.suffix!r}; known: {', '.join(TABLE_SUFFIXES)}")
    of_run = source.is_dir() and metrics is None
    chosen = metrics_asked(_of_run(source) if of_run else metrics or "paper")
    tracks, history = read_source(source)
    warn(tracks.notes)
    if source.is_dir():
        warn(["the tracks driven are the planned paths, so gap times and metrics along paths differ"])
    with as_written(source) if source.is_dir() else nullcontext():
        table = recording_table(tracks, level=level, metrics=chosen, history=history)
    about = {"level": level}
    # Its rule for leaders is a part of what a number means.
    if presets := [name for name in ("paper", "path") if {*SETS[name]} & {*chosen}]:
        about["preset"] = ", ".join(presets)
    table = table.replace_schema_metadata(about)
    words = ", ".join(f"{name} {value}" for name, value in about.items())
    if out is None:
        write_csv(table, sys.stdout.buffer)
        warn([words])
    else:
        write_table(table, out, source)
        print(f"{out}: {table.num_rows} rows, {words}")


def _of_run(folder: Path) -> tuple[str, ...]:
    """Return the metrics that a run evaluated."""
    from scex_sumo.metrics.registry import OURS, known_metrics
    from scex_sumo.results.run import open_run

    if not (folder / "run.json").is_file():
        return ("paper",)
    run = open_run(folder)
    names = [d["name"] for d in run.info.get("metrics", ())]
    # A file names no code to run: the user must name own functions.
    unknown = [name for name in names if name not in known_metrics()]
    if unknown:
        raise UsageError(
            f"{folder}: {', '.join(unknown)[:80]} is not installed; name other metrics, e.g. "
            f"--metrics {','.join([n for n in names if n in OURS] or ['ttc'])},package.module:function"
        )
    return tuple(names or [name for name in OURS if name in run.columns])
