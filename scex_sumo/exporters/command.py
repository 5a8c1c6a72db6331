"""``scex-sumo export``: futures in the formats of other tools."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from scex_sumo.base.errors import OwnCodeError, UsageError
from scex_sumo.base.files import TemporaryFolder, writing
from scex_sumo.base.outputs import check_output, remember
from scex_sumo.commands.options import Result

if TYPE_CHECKING:
    from scex_sumo.exporters.request import Exporter, Request
    from scex_sumo.results.run import Run


EXAMPLE = "out/roundabout --future 0 --to sumo -o out/simulation"

WITHOUT_RECORDED = ("interaction", "interpret", "fcd", "sumo", "ssm", "collisions", "mp4", "gif", "video")
"""Formats of futures that a run has simulated alone."""
WITH_RECORDED = "openscenario, commonroad, scenarionet, omega-prime, osi"


def export_command(
    folder: Result,
    future: Annotated[int | None, Option(metavar="N", help="Number of the future.")] = None,
    encounter: Annotated[
        str | None, Option(metavar="A,B", help="The typical future in which these two vehicles meet.")
    ] = None,
    every: Annotated[bool, Option("--all", help="All futures.")] = False,
    recorded: Annotated[bool, Option("--recorded", help=f"The recorded future ({WITH_RECORDED}).")] = False,
    to: Annotated[
        str,
        Option(
            metavar="FORMAT",
            help="interaction, interpret, fcd, openscenario (openscenario-1.3), commonroad, scenarionet, "
            "omega-prime, osi, sumo, ssm, collisions, mp4, gif; esmini and carla get openscenario.",
        ),
    ] = "interaction",
    ego: Annotated[
        int | None,
        Option(
            metavar="TRACK",
            help="Vehicle with the planning task (commonroad, scenarionet, interpret, openscenario).",
        ),
    ] = None,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="PATH", help="File or folder to write.")
    ] = None,
) -> None:
    """Write futures in another tool's format."""
    from scex_sumo.base.blame import own_call
    from scex_sumo.exporters.request import EXPORTERS, RECORDED, Request
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run

    write: Exporter = EXPORTERS.load(to)
    own = EXPORTERS.is_ours(to)
    if not own:
        write = own_call(f"export format {to}: it", write, list)
    if sum((future is not None, encounter is not None, every, recorded)) != 1:
        raise UsageError("export: give one of --future N, --encounter A,B, --all and --recorded")
    if recorded and to in WITHOUT_RECORDED:
        raise UsageError(f"--recorded: not with --to {to}; {WITH_RECORDED}")
    with as_written(folder):
        run = open_run(folder)
        pair = None if encounter is None else run.two_tracks(encounter)
        futures = (RECORDED,) if recorded else _futures(run, future, pair)
        request = Request(run=run, futures=futures, out=out, ego=ego, encounter=pair)
        request.ego_index()
    if out is not None and out.is_file() and not own:
        check_output(out, *request.inputs)
    # Another package's errors are no errors of the folder.
    with writing(out or Path()), as_written(folder) if own else nullcontext():
        files = write(request)
    if not own:
        remember(*(Path(file) for file in files))
        if len(request.futures) == 1:
            _refuse_other_content(to, write, request, files)
    for file in files:
        print(file)


def _refuse_other_content(to: str, write: Exporter, request: Request, files: Sequence[str | Path]) -> None:
    """Call another package's exporter once more, with a temporary folder, and compare its files."""
    with TemporaryFolder() as folder:
        again = write(replace(request, out=Path(folder, (request.out or Path("again")).name)))
        first, second = (list(map(Path, written)) for written in (files, again))
        if [x.read_bytes() for x in first if x.is_file()] != [x.read_bytes() for x in second if x.is_file()]:
            raise OwnCodeError(f"export format {to}: it wrote something else when called again")


def _futures(run: Run, future: int | None, encounter: tuple[int, int] | None) -> tuple[int, ...]:
    if future is not None:
        run.states(future)  # raises if there is no such future
        return (future,)
    return tuple(range(run.futures)) if encounter is None else (run.encounter(*encounter).row["future"],)
