"""Options of a run that change no value of its result: processes, folder, cache, progress."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.errors import UsageError
from scex_sumo.base.options import option
from scex_sumo.base.progress import Progress
from scex_sumo.behaviors.registry import is_own, model_specs
from scex_sumo.extrapolation.settings import FUTURES, MAX_FUTURES, RunSettings

AUTO: Final = "auto"
FUTURES_EACH: Final = 128
"""Futures of 3 s that take as long as the start of a worker."""


def read_workers(text: str) -> int | str:
    """Read a number of processes, or ``auto``."""
    if text != AUTO and not text.strip().lstrip("-").isdigit():
        raise UsageError(f"--workers {text}: needs a number or {AUTO}")
    return text if text == AUTO else int(text)


def no_bar(label: str) -> AbstractContextManager[None]:
    """Open no progress bar."""
    return nullcontext()


@dataclass(frozen=True, kw_only=True, eq=False)
class RunOptions:
    """Options of a run that change no value of its result.

    Attributes:
        out: None makes a temporary folder that lives as long as the run.
        workers: processes that share the futures, see `processes`; None for 1, on the command line ``auto``.
        batch: futures side by side in one world; None for about 5400 vehicles.
        cache: keep net, map features and assignments in ``~/.cache/scex-sumo``.
        extra: an object, too.
        bar: opens a progress bar by its label; yields a function of (done, total), or None.
        command: the command line, for ``run.json``.
        compared: compare a checked world with SUMO's.
        is_reference: it is the human-like reference of another run.

    Raises:
        UsageError: an option makes no sense.
    """

    workers: int | str | None = option(
        "Processes; auto (default): as many cores as help.",
        None,
        metavar="N|auto",
        takes=str,
        read=read_workers,
    )
    batch: int | None = option("Futures in one SUMO process; default: automatic.", None)
    gui: bool = option("Show the run live in sumo-gui, then its worst future.", False, names=("--gui",))
    cache: bool = option("Keep converted maps and assignments for the next run.", True)
    extra: Sequence[Any] = option(
        "An extra of your own; repeatable.", (), metavar="MODULE:CLASS[:OPTION=V]", several=True
    )
    overwrite: bool = option("Replace another run's result.", False, names=("--overwrite",))
    keep_doubtful: bool = option(
        "Encounters with doubtful data count, too.", False, names=("--keep-doubtful",)
    )
    out: str | Path | None = option("Result folder.", None, metavar="OUT", names=("-o", "--out"), takes=Path)
    bar: Callable[[str], AbstractContextManager[Progress | None]] = no_bar
    command: Sequence[str] | None = None
    compared: bool = True
    is_reference: bool = False

    def __post_init__(self) -> None:
        if self.batch is not None and self.batch < 1:
            raise UsageError(f"--batch: got {self.batch}, needs at least 1")
        if self.out is not None and Path(self.out).is_file():
            raise UsageError(f"-o {self.out}: is a file; name a folder")
        if isinstance(self.workers, str):
            read_workers(self.workers)

    def processes(self, settings: RunSettings) -> int:
        """Return the number of processes that work for a run.

        ``auto`` is one with a window or a driver of the user's, which may not bear to be sent to another
        process; else one for each `FUTURES_EACH` futures of 3 s, and no more than cores.
        """
        if self.gui:
            return 1
        if self.workers != AUTO:
            return min(1 if self.workers is None else int(self.workers), settings.count or MAX_FUTURES)
        if has_own_drivers(settings):
            return 1
        futures = FUTURES if settings.until_band is not None else settings.count or MAX_FUTURES
        help_by = futures * settings.steps // (FUTURES_EACH * RunSettings.steps)
        return max(1, min(cores(), help_by))


def has_own_drivers(settings: RunSettings) -> bool:
    """Return whether a run has drivers of the user's."""
    given = [*settings.assign.values(), *(one for one in settings.under_test.values() if one is not None)]
    return any(map(is_own, chain(settings.drawn, *map(model_specs, given))))


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
