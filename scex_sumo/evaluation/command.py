"""``scex-sumo metrics``: criticality metrics of a recording, a file of cases or a result folder."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import numbers_by_name
from scex_sumo.commands.console import warn
from scex_sumo.commands.options import complete_metrics
from scex_sumo.commands.tables import TABLE_SUFFIXES, write_csv, write_table

EXAMPLE = "vehicle_tracks_000.csv --level scene -o scenes.parquet"


def metrics_command(
    source: Annotated[
        Path, Argument(metavar="TRACKS|OUT", help="Tracks in INTERACTION format, or a result folder.")
    ],
    level: Annotated[str, Option(metavar="pair|scene|scenario|worst", help="Rows.")] = "scenario",
    preset: Annotated[
        str | None,
        Option(metavar="paper|path", help="Car-following rule: Default: paper, or that of the run in OUT."),
    ] = None,
    metrics: Annotated[
        str | None,
        Option(
            metavar="NAME,...",
            help="Metrics; default: the paper's six, or those of the run in OUT.",
            autocompletion=complete_metrics,
        ),
    ] = None,
    wttc_limits: Annotated[
        str | None, Option(metavar="TYPE=M/S2,...", help="Largest accelerations by type, for WTTC.")
    ] = None,
    repair: Annotated[bool, Option(help="Repair defects of recordings as 'run' does.")] = True,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="FILE", help="FILE.parquet or .csv; else CSV here.")
    ] = None,
) -> None:
    """Evaluate criticality metrics of recorded or simulated tracks."""
    from scex_sumo.evaluation.plans import read_plans
    from scex_sumo.evaluation.sources import read_source
    from scex_sumo.evaluation.tables import recording_table
    from scex_sumo.metrics.base import MetricParameters
    from scex_sumo.results.info import as_written
    from scex_sumo.results.tables.plans import PLANS

    if out is not None and out.suffix not in TABLE_SUFFIXES:
        raise UsageError(f"-o {out}: unknown format {out.suffix!r}; known: {', '.join(TABLE_SUFFIXES)}")
    names = None if metrics is None else tuple(name.strip() for name in metrics.split(","))
    if source.is_dir() and preset is None and names is None:
        preset, names = _of_run(source)
    preset = preset or "paper"
    entries = wttc_limits.lower().split(",") if wttc_limits else ()
    limits = numbers_by_name("--wttc-limits", entries, "TYPE=M/S2, e.g. truck=4.0")
    parameters = MetricParameters(max_acceleration_by_type=limits)
    tracks, history = read_source(source, repair=repair)
    warn(tracks.notes)
    with as_written(source):
        plans = read_plans(source) if source.is_dir() else None
    if source.is_dir() and plans is None:
        warn([f"{source}: has no {PLANS}; the tracks driven are the planned paths, so gap times differ"])
    options: dict[str, Any] = {"level": level, "preset": preset, "parameters": parameters, "metrics": names}
    with as_written(source) if source.is_dir() else nullcontext():
        table = recording_table(tracks, history=history, plans=plans, outcomes=source.is_dir(), **options)
    # The preset changes the meaning of every number.
    table = table.replace_schema_metadata({"preset": preset, "level": level})
    if out is None:
        write_csv(table, sys.stdout.buffer)
        warn([f"level {level}, preset {preset}"])
    else:
        write_table(table, out, source)
        print(f"{out}: {table.num_rows} rows, level {level}, preset {preset}")


def _of_run(folder: Path) -> tuple[str, tuple[str, ...] | None]:
    """Return the preset and the metrics that a run evaluated."""
    from scex_sumo.extrapolation.settings import RUN_PRESETS
    from scex_sumo.metrics.registry import METRICS, known_metrics
    from scex_sumo.results.run import open_run

    if not (folder / "run.json").is_file():
        return "paper", None
    info = open_run(folder).info
    preset = str(info.get("preset", "paper"))
    names = [d["name"] for d in info.get("metrics", ())]
    # A file names no code to run: the user must name own functions.
    unknown = [name for name in names if name not in known_metrics()]
    if unknown:
        raise UsageError(
            f"{folder}: {', '.join(unknown)[:80]} is not installed; name other metrics, e.g. "
            f"--metrics {','.join([n for n in names if n in METRICS] or ['ttc'])},package.module:function"
        )
    return "path" if preset == "path" else "paper", tuple(names) or RUN_PRESETS[preset]
