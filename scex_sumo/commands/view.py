"""``scex-sumo view``: child scenarios in sumo-gui."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from typing import Annotated

from typer import Option

from scex_sumo.commands.options import Result
from scex_sumo.errors import ScexError, UsageError
from scex_sumo.programs import environment, program


def view_command(
    folder: Result,
    child: Annotated[int | None, Option(metavar="N", help="Show this child.")] = None,
    grid: Annotated[int | None, Option(metavar="N", help="Show N children side by side.")] = None,
    critical: Annotated[
        str | None, Option(metavar="METRIC", help="Show the child most critical by this metric.")
    ] = None,
    write_only: Annotated[
        bool, Option("--write-only", help="Write the files, print the path, open nothing.")
    ] = False,
) -> None:
    """Open child scenarios in sumo-gui."""
    from scex_sumo.results.info import as_written
    from scex_sumo.results.run import open_run
    from scex_sumo.views.children import write_child, write_grid

    if sum(option is not None for option in (child, grid, critical)) > 1:
        raise UsageError("view: --child, --grid and --critical exclude one another; give one of them")
    with as_written(folder):
        run = open_run(folder)
        if grid is not None:
            file = write_grid(run, grid)
        elif critical is not None:
            file = write_child(run, run.most_critical(critical), title=f"most critical by {critical}")
        else:
            file = write_child(run, 0 if child is None else child)
    if write_only:
        print(file)
        return
    if not os.environ.get("DISPLAY") and sys.platform.startswith("linux"):
        raise ScexError(
            f"no display to open sumo-gui on; on a machine that has one: sumo-gui -c {shlex.quote(str(file))}"
        )
    command = [program("sumo-gui"), "-c", str(file)]
    status = subprocess.run(command, check=False, env=environment()).returncode
    if status != 0:
        raise ScexError(f"sumo-gui ended with status {status}; try it by hand: sumo-gui -c {file}")
