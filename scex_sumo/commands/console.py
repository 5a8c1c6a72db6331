"""Console of the commands: results go to standard output, everything else to standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from scex_sumo.errors import one_line

Tick = Callable[[int, int], None]


def warn(notes: Iterable[str]) -> None:
    """Print what the reader should know, one line each."""
    for note in notes:
        tell(f"note: {note}")


def tell(words: str) -> None:
    """Print to standard error in one line, which a terminal breaks between words."""
    lines = [one_line(words)]
    if sys.stderr.isatty():
        from shutil import get_terminal_size
        from textwrap import wrap

        wide = get_terminal_size().columns
        lines = wrap(lines[0], wide, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    print(*lines, sep="\n", file=sys.stderr)


@contextmanager
def progress_bar(label: str) -> Iterator[Tick | None]:
    """A progress bar on a terminal, nothing in a pipe; yields a function of (done, total)."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=None)

        def tick(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        yield tick


@contextmanager
def resumable(what: str, out: Path) -> Iterator[None]:
    """Ctrl-C ends the command and says that what is finished is kept.

    Raises:
        SystemExit: with status 130.
    """
    try:
        yield
    except KeyboardInterrupt:
        print(f"interrupted; finished {what} are kept in {out}, the same command goes on", file=sys.stderr)
        raise SystemExit(130) from None
