"""Options that several commands share, declared once, and what their text means."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from scex_sumo.commands.completion import complete_metrics, complete_models, complete_results
from scex_sumo.errors import UsageError

MapPath = Annotated[
    Path,
    typer.Argument(metavar="MAP", help="Lanelet2 .osm, CommonRoad .xml, SUMO .net.xml, OpenDRIVE .xodr."),
]
Origin = Annotated[
    str | None,
    typer.Option(metavar="LAT,LON", help="Origin of the map's coordinates; else from meta_data.csv."),
]
Tracks = Annotated[
    Path | None, typer.Option(metavar="CSV", help="Recorded tracks; else looked for beside the map.")
]
Fcd = Annotated[
    Path | None,
    typer.Option(metavar="FCD", help="Tracks of a SUMO simulation (fcd-output .xml, .xml.gz, .parquet)."),
]
State = Annotated[
    Path | None, typer.Option(metavar="STATE", help="Saved state of a SUMO simulation (.xml, .xml.gz).")
]
Case = Annotated[str | None, typer.Option(metavar="ID", help="Case of a file with case_id.")]
Time = Annotated[
    float | None, typer.Option(metavar="S", help="Moment in seconds; a run without takes the busiest.")
]
Synthetic = Annotated[
    int | None, typer.Option(metavar="N", help="Populate the map with N vehicles by SUMO instead.")
]
Models = Annotated[
    str | None,
    typer.Option(
        metavar="MODEL[@WEIGHT],...",
        help="Models to draw from; see 'scex-sumo models'.",
        autocompletion=complete_models,
    ),
]
Thresholds = Annotated[
    list[str] | None,
    typer.Option("--threshold", metavar="METRIC=VALUE", help="Where a metric becomes critical; repeatable."),
]
Roots = Annotated[
    list[Path],
    typer.Argument(metavar="DATASET...", help="Folders of recordings, or single files.", show_default=False),
]
Every = Annotated[float, typer.Option(metavar="S", help="Least time between two seed scenes.")]
MinVehicles = Annotated[int, typer.Option(help="Fewer moving vehicles make no seed scene.")]
Cluster = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:PORT", help="Dask scheduler, for its workers instead.")
]
Cache = Annotated[bool, typer.Option(help="Keep what is made of map and models for the next run.")]
Seed = Annotated[int, typer.Option(help="Random seed.")]
Processes = Annotated[int, typer.Option(help="Processes.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace another run's result.")]
Result = Annotated[
    Path, typer.Argument(metavar="OUT", help="Result folder.", autocompletion=complete_results)
]
ResultPath = Annotated[Path | None, typer.Option("-o", "--out", metavar="OUT", help="Result folder.")]


def metric_option(help: str) -> Any:
    """An option that takes one metric."""
    return typer.Option(metavar="METRIC", help=help, autocompletion=complete_metrics)


def parse_thresholds(entries: Sequence[str] | None) -> dict[str, float]:
    """``METRIC=VALUE`` entries as a mapping.

    Raises:
        UsageError: an entry is not of that form.
    """
    result = {}
    for entry in entries or ():
        column, _, value = entry.partition("=")
        try:
            result[column] = float(value)
        except ValueError:
            raise UsageError(f"--threshold {entry}: needs METRIC=VALUE, e.g. --threshold ttc=0.5") from None
    return result


def two_tracks(text: str) -> tuple[int, int]:
    """``A,B`` of ``--encounter`` as two track ids.

    Raises:
        UsageError: it is none.
    """
    first, _, second = text.partition(",")
    if not (first.strip().isdigit() and second.strip().isdigit()):
        raise UsageError(f"--encounter {text}: give the ids of two vehicles, e.g. --encounter 11,7")
    return int(first), int(second)
