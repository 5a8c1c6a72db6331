"""Command line: which commands there are, and what their errors become."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
from types import FrameType
from typing import Annotated

import typer

from scex_sumo.commands.convert import convert_command
from scex_sumo.commands.inspect import inspect_command
from scex_sumo.commands.metrics import metrics_command
from scex_sumo.commands.models import models_command
from scex_sumo.commands.of_datasets.rank import rank_command
from scex_sumo.commands.of_datasets.train import train_command
from scex_sumo.commands.of_datasets.validate import validate_command
from scex_sumo.commands.of_results.compare import compare_command
from scex_sumo.commands.of_results.encounters import encounters_command
from scex_sumo.commands.of_results.explain import explain_command
from scex_sumo.commands.of_results.export import export_command
from scex_sumo.commands.of_results.plot import plot_command
from scex_sumo.commands.of_results.report import report_command
from scex_sumo.commands.of_results.view import view_command
from scex_sumo.commands.run import run_command
from scex_sumo.commands.sample_size import sample_size_command
from scex_sumo.errors import ScexError, UsageError, one_line

GARBAGE_AFTER = 100_000  # new objects; Python's own is 700

app = typer.Typer(
    name="scex-sumo",
    help="Hundreds of futures of one moment of traffic, and how critical it can become.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from scex_sumo.version import __version__

        print(f"scex-sumo {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True)] = False,
) -> None:
    pass


COMMANDS = (
    (run_command, "run k733.osm --tracks vehicle_tracks_000.csv --time 60 -o out/k733"),
    (convert_command, "convert DR_DEU_Roundabout_OF.osm -o roundabout.net.xml"),
    (inspect_command, "inspect k733.osm --tracks vehicle_tracks_000.csv --time 60"),
    (report_command, "report out/k733"),
    (plot_command, "plot out/k733 --metric ttc -o ttc.svg"),
    (view_command, "view out/k733 --critical wttc"),
    (export_command, "export out/k733 --critical ttc --top 5 --to openscenario -o critical"),
    (encounters_command, "encounters out/k733 --pair 17,23"),
    (metrics_command, "metrics vehicle_tracks_000.csv --level scene -o scenes.parquet"),
    (sample_size_command, "sample-size roundabout.osm -o out/enough"),
    (rank_command, "rank recordings/ --every 1 --workers 8 -o out/ranking"),
    (validate_command, "validate recordings/ --models likely --workers 8 -o out/validation"),
    (compare_command, "compare out/k733 out/k729 out/merge -o out/compared"),
    (explain_command, "explain out/k733 --metric ttc"),
    (train_command, "train graph --data ../shared/data/mona --data taf_bw --out mine.pt"),
    (models_command, "models"),
)
for _command, _example in COMMANDS:
    app.command(_example.split()[0], epilog=f"Example: scex-sumo {_example}")(_command)


def main() -> None:
    """Entry point: errors become one line and an exit status."""
    # Numpy's products are small here; its threads, one for each core, cost more to start than they save.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Objects of a run live as long as it does: looking for garbage among them takes a tenth of a short run.
    gc.set_threshold(GARBAGE_AFTER)
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
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
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


def _stop(number: int, _frame: FrameType | None) -> None:
    _stopped.append(number)
    raise KeyboardInterrupt


_stopped: list[int] = []  # signals that asked the process to stop


def _is_out_of_memory(error: Exception) -> bool:
    """Whether memory ran out, in Python or in a library that says so only in words."""
    words = ("bad_alloc", "not enough memory", "Cannot allocate memory", "failed to map segment")
    return isinstance(error, MemoryError) or any(word in str(error) for word in words)


def _fail(message: str, status: int) -> None:
    print(one_line(message), file=sys.stderr)
    raise SystemExit(status)
