"""Console of the commands: results on standard output, everything else on standard error."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from scex_sumo.base.errors import one_line
from scex_sumo.base.progress import Progress, progress_of

if TYPE_CHECKING:
    from rich.console import Console

level = 0
"""1 with ``--verbose``: notes in full; -1 with ``--quiet``: neither notes nor progress."""

# Control characters except tab and line feed, and those that turn the direction of text.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def printable(text: str) -> str:
    """Return a text with its control characters as ``\\x1b``: no file may command the terminal."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


class PrintableStream:
    """Standard stream that writes printable text only."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text with its control characters escaped."""
        return self.stream.write(printable(text))

    def writelines(self, lines: Iterable[str]) -> None:
        """Write texts, as `write`."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def print_safely() -> None:
    """Escape control characters in all that is printed from now on."""
    sys.stdout, sys.stderr = (cast(TextIO, PrintableStream(s)) for s in (sys.stdout, sys.stderr))


def output_console(*, width: int) -> Console:
    """Return a console for tables with printable text, of some width if the output is no terminal."""
    from rich.console import Console
    from rich.segment import Segment

    class PrintableConsole(Console):
        def render(self, *arguments: Any, **options: Any) -> Iterator[Segment]:
            for text, style, control in super().render(*arguments, **options):
                yield Segment(text if control else printable(text), style, control)

    stream = getattr(sys.stdout, "stream", sys.stdout)
    return PrintableConsole(file=stream, width=None if stream.isatty() else width)


def warn(notes: Iterable[str]) -> None:
    """Print notes to standard error, one line each; with ``--quiet`` warnings only."""
    for note in notes:
        if level >= 0 or note.startswith("warning: "):
            tell(note if note.startswith("warning: ") else f"note: {note}")


def tell(words: str) -> None:
    """Print one line to standard error; a terminal breaks it between words."""
    lines = [one_line(words)]
    if sys.stderr.isatty():
        from shutil import get_terminal_size
        from textwrap import wrap

        wide = get_terminal_size().columns
        lines = wrap(lines[0], wide, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    print(*lines, sep="\n", file=sys.stderr)


def progress_bar(label: str) -> AbstractContextManager[Progress | None]:
    """Open a function of (done, total) that moves a progress bar; None without a terminal or if quiet."""
    return progress_of(level >= 0, printable(label))


@contextmanager
def resumable(what: str, out: Path) -> Iterator[None]:
    """End the command at Ctrl-C with status 130, and say that finished parts are kept."""
    try:
        yield
    except KeyboardInterrupt:
        print(f"interrupted; {out} keeps finished {what}; run the same command to go on", file=sys.stderr)
        raise SystemExit(130) from None
