"""Options that several commands share, their meaning, and the completion of values in a shell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import last_of_list


def complete_models(incomplete: str) -> list[str]:
    """Complete the last of a list of models and sets of models."""
    from scex_sumo.extrapolation.settings import complete_models as complete

    return complete(incomplete)


def complete_metrics(incomplete: str) -> list[str]:
    """Complete the last of a list of metrics."""
    from scex_sumo.metrics.registry import known_metrics

    return last_of_list(incomplete, known_metrics())


def complete_results(incomplete: str) -> list[str]:
    """Complete a result folder, also one in a folder that begins as typed."""
    typed, slash, begin = incomplete.rpartition("/")
    within = Path(typed + slash)
    results = [file for depth in ("*", "*/*") for file in within.glob(f"{depth}/run.json")]
    names = (file.parent.relative_to(within).as_posix() for file in results)
    return sorted(f"{typed}{slash}{name}" for name in names if name.startswith(begin))


def processes(text: str) -> int:
    """Read a number of processes; ``auto`` is one for each core."""
    from scex_sumo.extrapolation.options import AUTO, cores, read_workers

    workers = read_workers(text)
    return cores() if workers == AUTO else int(workers)


Origin = Annotated[
    str | None,
    typer.Option(metavar="LAT,LON", help="Origin of the map's coordinates; default: that of meta_data.csv."),
]
Tracks = Annotated[
    Path | None, typer.Option(metavar="CSV", help="Recorded tracks; default: those beside the map.")
]
Case = Annotated[str | None, typer.Option(metavar="ID", help="Case of a file with case_id.")]
Time = Annotated[float | None, typer.Option(metavar="S", help="Moment in seconds; default: the busiest.")]
Speed = Annotated[
    float | None,
    typer.Option(
        metavar="V",
        help="Of scenes as recorded: mean speed of the traffic, m/s; default: drawn for road and density.",
    ),
]
Models = Annotated[
    str | None,
    typer.Option(
        metavar="MODEL[@WEIGHT],...",
        help="Models to draw from; see 'scex-sumo models'.",
        autocompletion=complete_models,
    ),
]
Preset = Annotated[
    str, typer.Option(metavar="paper|path|both", help="Metrics: the paper's, those along paths, or both.")
]
Metrics = Annotated[
    str | None, typer.Option(metavar="NAME,...", help="Metrics, built-in or your own; default: the preset's.")
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
MinVehicles = Annotated[int, typer.Option(help="Smallest number of moving vehicles of a seed scene.")]
Cluster = Annotated[
    str | None, typer.Option(metavar="tcp://HOST:PORT", help="Dask scheduler whose workers run the futures.")
]
Cache = Annotated[bool, typer.Option(help="Keep converted maps and assignments for the next run.")]
Seed = Annotated[int, typer.Option(help="Random seed.")]
Processes = Annotated[
    Any,
    typer.Option(
        metavar="N|auto", help="Processes; auto: one for each core.", parser=processes, envvar="SCEX_WORKERS"
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace another run's result.")]
InRegion = Annotated[
    str | None, typer.Option("--region", metavar="X,Y,R", help="Only pairs with a vehicle in this circle, m.")
]
Around = Annotated[
    int | None, typer.Option(metavar="TRACK", help="Only pairs with a vehicle within 30 m of this one.")
]
Result = Annotated[
    Path, typer.Argument(metavar="OUT", help="Result folder.", autocompletion=complete_results)
]
ResultPath = Annotated[Path | None, typer.Option("-o", "--out", metavar="OUT", help="Result folder.")]


def metric_option(help: str) -> Any:
    """Return an option that takes one metric."""
    return typer.Option(metavar="METRIC", help=help, autocompletion=complete_metrics)


def two_tracks(text: str, option: str = "--encounter") -> tuple[int, int]:
    """Return ``A,B`` of an option as two track ids; a `UsageError` for another text."""
    first, _, second = text.partition(",")
    if not all(part.strip().removeprefix("-").isdecimal() for part in (first, second)):
        raise UsageError(f"{option} {text}: needs two track ids, e.g. {option} 11,7")
    return int(first), int(second)
