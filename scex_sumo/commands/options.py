"""Options that several commands share, and their meaning."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from scex_sumo.base.options import Option
from scex_sumo.base.processes import AUTO, cores, read_workers


def processes(text: str) -> int:
    """Read a number of processes; ``auto`` is one for each core."""
    workers = read_workers(text)
    return cores() if workers == AUTO else int(workers)


MapPath = Annotated[
    Path,
    typer.Argument(
        metavar="MAP", help="Lanelet2, CommonRoad, SUMO, OpenDRIVE, Argoverse 2, ..., or a folder with one."
    ),
]
Origin = Annotated[
    str | None,
    typer.Option(metavar="LAT,LON", help="Origin of the map's coordinates; default: that of meta_data.csv."),
]
Tracks = Annotated[
    Path | None, typer.Option(metavar="CSV", help="Recorded tracks; default: those beside the map.")
]
Case = Annotated[str | None, typer.Option(metavar="ID", help="Case of a file with case_id.")]
Time = Annotated[float | None, typer.Option(metavar="S", help="Moment in seconds; default: the busiest.")]
Roots = Annotated[
    list[Path],
    typer.Argument(metavar="DATASET...", help="Folders of recordings, or single files.", show_default=False),
]
Every = Annotated[float, typer.Option(metavar="S", help="Least time between two seed scenes.")]
Seed = Annotated[int, typer.Option(help="Random seed.")]
Processes = Annotated[
    Any,
    typer.Option(
        metavar="N|auto", help="Processes; auto: one for each core.", parser=processes, envvar="SCEX_WORKERS"
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace another result.")]
OutFolder = Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder of the result.")]
Result = Annotated[Path, typer.Argument(metavar="OUT", help="Result folder.")]


def with_options(kinds: Sequence[type]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a command: in place of ``**given`` it takes the options of dataclasses, in their order."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        signature = inspect.signature(command, eval_str=True)
        own = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
        hints = {kind: get_type_hints(kind) for kind in kinds}
        options = ((kind, field) for kind in kinds for field in fields(kind) if "option" in field.metadata)
        more = [_parameter(field, hints[kind][field.name]) for kind, field in options]
        last = [p for p in own if p.kind is inspect.Parameter.KEYWORD_ONLY]
        first = [p for p in own if p not in last]
        command.__signature__ = signature.replace(parameters=[*first, *more, *last])  # type: ignore[attr-defined]
        return command

    return decorate


def _parameter(field: Field[Any], hint: Any) -> inspect.Parameter:
    """Return an option of a dataclass as a keyword parameter that Typer reads."""
    about: Option = field.metadata["option"]
    if about.several:
        hint, default = list[str] | None, None
    elif about.takes is not None:
        hint, default = about.takes | None, None
    else:
        default = None if field.default is MISSING else field.default
    names = about.names or ((f"--{field.name.replace('_', '-')}",) if hint is not bool else ())
    option = typer.Option(*names, metavar=about.metavar, help=about.help, rich_help_panel=about.panel)
    keyword = inspect.Parameter.KEYWORD_ONLY
    return inspect.Parameter(field.name, keyword, default=default, annotation=Annotated[hint, option])
