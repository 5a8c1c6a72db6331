"""Progress of long functions: a callback, or a bar on a terminal or in a notebook."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

Progress: TypeAlias = Callable[[int, int], None]


@contextmanager
def progress_of(wanted: Progress | bool | None, label: str) -> Iterator[Progress | None]:
    """Yield the function of (done, total) that shows progress.

    Args:
        wanted: such a function; True for a bar on standard error, if it is a terminal or a notebook's; None
            or False for nothing.
    """
    if wanted is not True:
        yield wanted or None
        return
    stream = getattr(sys.stderr, "stream", sys.stderr)  # a bar needs control characters
    if not (stream.isatty() or type(stream).__module__.startswith("ipykernel")):
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    # Rich's own bar of notebooks needs ipywidgets. What a driver prints stays on standard output.
    console = Console(file=stream, force_terminal=True, force_jupyter=False)
    with Bars(*columns, console=console, transient=True, redirect_stdout=False) as bars:
        task = bars.add_task(label, total=None)

        def tick(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield tick
