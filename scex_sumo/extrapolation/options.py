"""Options of a run that change no value of its result: processes, folder, cache, progress."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import option
from scex_sumo.base.processes import AUTO, idle_cores, read_workers
from scex_sumo.base.progress import Progress
from scex_sumo.drivers.registry import is_own, model_specs
from scex_sumo.extrapolation.settings import MAX_FUTURES, PEOPLE, RunSettings

OUTPUT: Final = "Output"
"""Group of these options in the help."""

FUTURES_EACH: Final = 128
"""Futures of 3 s that take as long as the start of a worker."""


def no_bar(label: str) -> AbstractContextManager[None]:
    """Open no progress bar."""
    return nullcontext()


@dataclass(frozen=True, kw_only=True, eq=False)
class RunOptions:
    """Options of a run that change no value of its result.

    Attributes:
        out: None makes a temporary folder that lives as long as the run.
        workers: processes that share the futures, see `processes`; None for 1, on the command line ``auto``.
        cache: keep net, map features and assignments in ``~/.cache/scex-sumo``.
        extra: an object, too.
        bar: opens a progress bar by its label; yields a function of (done, total), or None.
        command: the command line, for ``run.json``.
        is_reference: it is the human-like reference of another run.

    Raises:
        UsageError: an option makes no sense.
    """

    workers: int | str | None = option(
        "Processes; auto (default): as many cores as help.",
        None,
        metavar="N|auto",
        panel=OUTPUT,
        takes=str,
        read=read_workers,
    )
    gui: bool = option(
        "Show the run live in sumo-gui, then its worst future.", False, names=("--gui",), panel=OUTPUT
    )
    reference: str | None = option(
        "Human-like reference, run after the stress test.",
        "likely",
        metavar="MIX|none",
        panel=PEOPLE,
        takes=str,
    )
    report: bool = option("Write report.html.", True, names=("--report/--no-report",), panel=OUTPUT)
    extra: Sequence[Any] = option(
        "An extra of your own; repeatable.", (), metavar="MODULE:CLASS[:OPTION=V]", panel=OUTPUT, several=True
    )
    overwrite: bool = option("Replace another run's result.", False, names=("--overwrite",), panel=OUTPUT)
    out: str | Path | None = option(
        "Result folder.", None, metavar="OUT", names=("-o", "--out"), panel=OUTPUT, takes=Path
    )
    cache: bool = True
    bar: Callable[[str], AbstractContextManager[Progress | None]] = no_bar
    command: Sequence[str] | None = None
    is_reference: bool = False

    def __post_init__(self) -> None:
        if self.out is not None and Path(self.out).is_file():
            raise UsageError(f"-o {self.out}: is a file; name a folder")
        if isinstance(self.workers, str):
            read_workers(self.workers)
        if self.extra:
            from scex_sumo.extrapolation.extras import extra_named

            object.__setattr__(self, "extra", tuple(map(extra_named, self.extra)))

    @property
    def human(self) -> str | None:
        """Models of the human-like reference; None without one."""
        return None if self.reference in (None, "none") else self.reference

    def processes(self, settings: RunSettings) -> int:
        """Return the number of processes that work for a run.

        ``auto`` is one with a window or a driver of the user's, which may not bear to be sent to another
        process; else one for each `FUTURES_EACH` futures of 3 s, and no more than idle cores.
        """
        if self.gui:
            return 1
        if self.workers != AUTO:
            return min(1 if self.workers is None else int(self.workers), settings.count or MAX_FUTURES)
        tested = chain.from_iterable(map(model_specs, filter(None, settings.under_test.values())))
        if any(map(is_own, chain(settings.drawn, tested))):  # own ones of ``assign`` are under test
            return 1
        help_by = (settings.count or MAX_FUTURES) * settings.steps // (FUTURES_EACH * RunSettings.steps)
        return max(1, min(idle_cores(), help_by))


RUN_OPTIONS: Final = (RunSettings, RunOptions)
"""The dataclasses whose fields are the options of a run."""
