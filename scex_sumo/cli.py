"""Command line: registry of commands; one line and an exit status for each error."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Sequence
from types import FrameType
from typing import Annotated, Any

import typer

from scex_sumo.base.errors import ScexError, ScexWarning, UsageError, last_words
from scex_sumo.base.options import present_names
from scex_sumo.commands import console
from scex_sumo.commands.console import print_safely, tell
from scex_sumo.commands.shared import COMMANDS, Command, with_shared


def _version(wanted: bool) -> None:
    if wanted:
        from scex_sumo.base.version import __version__

        print(f"scex-sumo {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False,
) -> None:
    """Take the options of all commands."""


def command_line(arguments: Sequence[str] = ()) -> typer.Typer:
    """Build the application with the given command alone, or with all commands for their list.

    Loading one command takes milliseconds, loading all of them a second.
    """
    names = COMMANDS.paths
    alone = bool(arguments) and arguments[0] in names
    group: Any = None
    if not alone:
        from scex_sumo.commands.help import CommandGroup

        group = CommandGroup
    app = typer.Typer(
        name="scex-sumo",
        cls=group,
        help="Hundreds of futures of one moment of traffic, and how critical it can become.",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    if alone:
        _add(app, arguments[0])
        return app
    for name in names:
        try:
            _add(app, name)
        except UsageError as error:  # a broken command of another package
            tell(f"warning: command {name} is left out: {error}")
    return app


def _add(app: typer.Typer, name: str) -> None:
    command = COMMANDS.load(name)
    example = f"{name} {getattr(sys.modules[command.__module__], 'EXAMPLE', '')}".rstrip()
    app.command(name, cls=Command, epilog=f"scex-sumo {example}")(with_shared(command))


INTERRUPTED = 130


def main() -> None:
    """Run the command line; errors become one line and an exit status."""
    # NumPy's products are small: threads cost more than they save.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # SIGTERM does the same as Ctrl-C: finished futures stay, workers end.
    signal.signal(signal.SIGTERM, _stop)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored, as by nohup
        signal.signal(signal.SIGINT, _stop)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by some schedulers
            setattr(sys, name, io.StringIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # ? for – on some terminals
    print_safely()
    last_words.append(lambda words: tell(f"error: {words}"))
    warnings.simplefilter("ignore", ScexWarning)  # commands print the notes
    try:
        sys.argv[1:] = present_names(sys.argv[1:])
        gc.disable()
        command = command_line(sys.argv[1:])
        gc.freeze()  # what imports have made stays: searching it for garbage costs .15 s of a run
        gc.enable()
        status = command(sys.argv[1:] or ["--help"], standalone_mode=False)
        sys.stdout.flush()
    except ScexError as error:
        if console.level > 0:
            traceback.print_exc()
        _fail(f"error: {error}", 2 if isinstance(error, UsageError) else 1)
    except (typer.Abort, KeyboardInterrupt):
        _fail("interrupted", INTERRUPTED)
    except BrokenPipeError:
        sys.stderr.close()
        raise SystemExit(1) from None
    except OSError as error:  # a full disk, a removed file
        where = error.filename2 or error.filename or "standard output or a file"  # filename2: of a copy
        _fail(f"error: {where}: {error.strerror or error}; correct it and try again", 1)
    except Exception as error:
        if _stopped:  # a library that was being imported raised its own error
            _fail("interrupted", INTERRUPTED)
        if _is_out_of_memory(error):
            _fail("error: out of memory; ask for fewer --futures, --steps or --workers", 1)
        shown = getattr(error, "format_message", None)
        if shown is None:
            raise
        _fail(f"error: {shown()}", 2)
    if status:  # Typer turns Ctrl-C into a status
        _fail("interrupted", int(status))


def _stop(number: int, _frame: FrameType | None) -> None:
    _stopped.append(number)
    raise KeyboardInterrupt


_stopped: list[int] = []


def _is_out_of_memory(error: Exception) -> bool:
    words = ("bad_alloc", "not enough memory", "Cannot allocate memory", "failed to map segment")
    return isinstance(error, MemoryError) or any(word in str(error) for word in words)


def _fail(message: str, status: int) -> None:
    tell(message)
    raise SystemExit(status)
