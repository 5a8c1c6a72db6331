"""``scex-sumo metrics``: criticality metrics of a recording, a file of cases or a result folder."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.commands.console import warn
from scex_sumo.errors import MapError, ResultError, UsageError

if TYPE_CHECKING:
    import pyarrow as pa

SUFFIXES = (".parquet", ".csv")


def metrics_command(
    source: Path,
    *,
    map_path: Path | None,
    level: str,
    preset: str,
    metrics: str | None,
    by_type: str | None,
    out: Path | None,
) -> None:
    """Evaluate and write a table; as CSV to standard output where no file is given."""
    from scex_sumo.evaluation.plans import PLANS, read_plans
    from scex_sumo.evaluation.sources import read_source
    from scex_sumo.evaluation.tables import recording_table
    from scex_sumo.metrics.base import MetricParameters

    if out is not None and out.suffix not in SUFFIXES:
        raise UsageError(f"-o {out}: unknown format {out.suffix!r}; known: {', '.join(SUFFIXES)}")
    if map_path is not None and not map_path.is_file():
        raise MapError(f"{map_path}: no such file; the metrics need no map, leave --map out")
    names = None if metrics is None else tuple(name.strip() for name in metrics.split(","))
    parameters = MetricParameters(max_acceleration_by_type=_limits(by_type))
    tracks, history = read_source(source)
    plans = read_plans(source) if source.is_dir() else None
    if source.is_dir() and plans is None:
        warn([f"{source}: has no {PLANS}; the tracks driven are the planned paths, so gap times differ"])
    table = recording_table(
        tracks,
        level=level,
        preset=preset,
        parameters=parameters,
        metrics=names,
        history=history,
        plans=plans,
    )
    # The preset is part of every number's meaning, so it goes with the file.
    table = table.replace_schema_metadata({"preset": preset, "level": level})
    if out is None:
        _write_csv(table, sys.stdout.buffer)
        warn([f"level {level}, preset {preset}"])
    else:
        write_table(table, out)
        print(f"{out}: {table.num_rows} rows, level {level}, preset {preset}")


def write_table(table: pa.Table, path: Path) -> None:
    """Write a table as Parquet or CSV, whole or not at all."""
    import pyarrow.parquet as pq

    temporary = path.with_name(f".{path.name}.writing")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".parquet":
            pq.write_table(table, temporary)
        else:
            with temporary.open("wb") as file:
                _write_csv(table, file)
        temporary.replace(path)
    except OSError as error:
        raise ResultError(f"{path}: cannot write: {error.strerror or error}") from None


def _write_csv(table: pa.Table, file: Any) -> None:
    from pyarrow import csv

    csv.write_csv(table, file, csv.WriteOptions(quoting_style="needed"))
    file.flush()


def _limits(text: str | None) -> dict[str, float]:
    """``truck=4,bus=3`` as a mapping."""
    limits = {}
    for part in text.split(",") if text else ():
        name, _, value = part.partition("=")
        try:
            limits[name.strip().lower()] = float(value)
        except ValueError:
            raise UsageError(f"--wttc-limits: {part!r} is not TYPE=M/S2, e.g. truck=4.0") from None
    return limits
