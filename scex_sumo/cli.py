"""Command line: which commands there are, and what their errors become."""

from __future__ import annotations

import atexit
import gc
import importlib
import importlib.util
import io
import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType
from typing import Annotated, Any

import typer

from scex_sumo.commands.console import tell
from scex_sumo.errors import ScexError, UsageError

GARBAGE_AFTER = 250_000  # new objects; Python's own is 700


def _version(wanted: bool) -> None:
    if wanted:
        from scex_sumo.version import __version__

        print(f"scex-sumo {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False,
) -> None:
    _do_without_pandas()


COMMANDS = {
    "run": ("run", "k733.osm --tracks vehicle_tracks_000.csv --time 60 -o out/k733"),
    "convert": ("convert", "DR_DEU_Roundabout_OF.osm -o roundabout.net.xml"),
    "inspect": ("inspect", "k733.osm --tracks vehicle_tracks_000.csv --time 60"),
    "report": ("of_results.report", "out/k733"),
    "plot": ("of_results.plot", "out/k733 --metric ttc -o ttc.svg"),
    "view": ("of_results.view", "out/k733 --critical wttc"),
    "export": ("of_results.export", "out/k733 --critical ttc --top 5 --to openscenario -o critical"),
    "encounters": ("of_results.encounters", "out/k733 --pair 17,23"),
    "metrics": ("metrics", "vehicle_tracks_000.csv --level scene -o scenes.parquet"),
    "sample-size": ("sample_size", "roundabout.osm -o out/enough"),
    "rank": ("of_datasets.rank", "recordings/ --every 1 --workers 8 -o out/ranking"),
    "validate": ("of_datasets.validate", "recordings/ --models likely --workers 8 -o out/validation"),
    "compare": ("of_results.compare", "out/k733 out/k729 out/merge -o out/compared"),
    "explain": ("of_results.explain", "out/k733 --metric ttc"),
    "train": ("of_datasets.train", "graph --data INTERACTION --out mine.safetensors"),
    "models": ("models", ""),
}
"""Module in `scex_sumo.commands` and example of each command; its function is ``NAME_command``."""


def _app(arguments: Sequence[str]) -> typer.Typer:
    """All commands, or the one that is asked for: to know the options of a command takes milliseconds."""
    app = typer.Typer(
        name="scex-sumo",
        help="Hundreds of futures of one moment of traffic, and how critical it can become.",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    for name in arguments[:1] if arguments and arguments[0] in COMMANDS else COMMANDS:
        module, example = COMMANDS[name]
        found = importlib.import_module(f"scex_sumo.commands.{module}")
        app.command(name, epilog=f"Example: scex-sumo {name} {example}".rstrip())(
            getattr(found, f"{name.replace('-', '_')}_command")
        )
    return app


def main() -> None:
    """Entry point: errors become one line and an exit status."""
    # Numpy's products are small here; its threads, one for each core, cost more to start than they save.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Objects of a run live as long as it does: looking for garbage among them takes a tenth of a short run.
    gc.set_threshold(GARBAGE_AFTER)
    atexit.register(gc.freeze)  # nor does it at the end, where Python would for nothing
    # A scheduler's SIGTERM leaves what Ctrl-C leaves: finished children, and no worker behind.
    signal.signal(signal.SIGTERM, _stop)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where it is ignored, as by nohup
        signal.signal(signal.SIGINT, _stop)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as some schedulers leave it
            setattr(sys, name, io.StringIO())
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without – gets ? for it
    try:
        status = _app(sys.argv[1:])(sys.argv[1:] or ["--help"], standalone_mode=False)
    except ScexError as error:
        _fail(f"error: {error}", 2 if isinstance(error, UsageError) else 1)
    except typer.Abort:
        _fail("interrupted", 130)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        raise SystemExit(1) from None
    except OSError as error:  # of the machine, not of the program: a full disk, a file taken away
        _fail(f"error: {error.filename or 'a file'}: {error.strerror or error}; see to it and try again", 1)
    except Exception as error:
        if _stopped:  # while a library was being imported, which made an error of its own of it
            _fail("interrupted", 130)
        if _is_out_of_memory(error):
            _fail(
                "error: out of memory; ask for fewer --children, --steps or --workers, or a smaller --batch",
                1,
            )
        shown = getattr(error, "format_message", None)
        if shown is None:
            raise
        _fail(f"error: {shown()}", 2)
    if status:  # Typer turns Ctrl-C into a status
        _fail("interrupted", int(status))


class _NotNow:
    """Finder of modules by which there is no pandas."""

    def find_spec(self, name: str, *_: object) -> None:
        if name == "pandas":
            raise ModuleNotFoundError(name)


def _do_without_pandas() -> None:
    """Keep Arrow from importing pandas, 0.2 s, to see whether a list is one of its columns; it looks once.

    Whoever asks Arrow for a data frame gets it all the same, and has it imported then.
    """
    if "pandas" in sys.modules or importlib.util.find_spec("pandas") is None:
        return
    finder: Any = _NotNow()
    sys.meta_path.insert(0, finder)
    try:
        importlib.import_module("pyarrow").array([0])
    finally:
        sys.meta_path.remove(finder)


def _stop(number: int, _frame: FrameType | None) -> None:
    _stopped.append(number)
    raise KeyboardInterrupt


_stopped: list[int] = []  # signals that asked the process to stop


def _is_out_of_memory(error: Exception) -> bool:
    """Whether memory ran out, in Python or in a library that says so only in words."""
    words = ("bad_alloc", "not enough memory", "Cannot allocate memory", "failed to map segment")
    return isinstance(error, MemoryError) or any(word in str(error) for word in words)


def _fail(message: str, status: int) -> None:
    tell(message)
    raise SystemExit(status)
