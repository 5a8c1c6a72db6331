"""``scex-sumo view``: futures in sumo-gui."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Annotated

from typer import Option

from scex_sumo.base.errors import ScexError, UsageError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.commands.options import Result

EXAMPLE = "out/roundabout --encounter 11,7"


def view_command(
    folder: Result,
    future: Annotated[int | None, Option(metavar="N", help="Show this future.")] = None,
    grid: Annotated[int | None, Option(metavar="N", help="Show the N most different futures.")] = None,
    encounter: Annotated[
        str | None, Option(metavar="A,B", help="Show two vehicles in a typical future in which they meet.")
    ] = None,
    write_only: Annotated[
        bool, Option("--write-only", help="Write the files, print the path, open nothing.")
    ] = False,
) -> None:
    """Open futures in sumo-gui; by default the pair of the verdict."""
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run
    from scex_sumo.views.futures import write_encounter, write_first, write_future, write_grid

    if sum(option is not None for option in (future, grid, encounter)) > 1:
        raise UsageError("view: --future, --grid and --encounter exclude one another; give one of them")
    with as_written(folder):
        run = open_run(folder)
        if grid is not None:
            file = write_grid(run, grid)
        elif encounter is not None:
            file = write_encounter(run, *run.two_tracks(encounter))
        elif future is not None:
            file = write_future(run, future)
        else:
            file = write_first(run)
    if write_only:
        print(file)
    else:
        _show(file)


def _show(file: Path) -> None:
    """Open a file in sumo-gui until its window is closed; `ScexError` without a display."""
    # A bare file name, because SUMO splits the paths of a configuration at commas.
    by_hand = f"cd {shlex.quote(str(file.parent))} && sumo-gui -c {shlex.quote(file.name)}"
    if not os.environ.get("DISPLAY") and sys.platform.startswith("linux"):
        raise ScexError(f"no display for sumo-gui; on a machine with a display: {by_hand}")
    command = [program("sumo-gui"), "-c", file.name]
    # sumo-gui prints to stdout how each person with a visible id walks.
    quiet = subprocess.DEVNULL
    status = subprocess.run(command, check=False, env=environment(), cwd=file.parent, stdout=quiet).returncode
    if status != 0:
        raise ScexError(f"sumo-gui ended with status {status}; try it by hand: {by_hand}")
