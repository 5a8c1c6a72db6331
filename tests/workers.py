"""Worker processes that are forked off one that has imported the package, and start in milliseconds.

Tests of worker processes themselves have those of the package: `NEW_PROCESSES`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

from scex_sumo.extrapolation.processes import process


class ForkedWorker:
    """What `process.WorkerProcess` uses of `subprocess.Popen`."""

    context: ClassVar[BaseContext]
    ours: ClassVar[set[int]] = set()  # ends of pipes that workers forked off this process have to close

    def __init__(self, words: Sequence[str], *, env: Mapping[str, str], **_: object) -> None:
        orders, reports = os.pipe(), os.pipe()
        self.ours.update((orders[1], reports[0]))
        theirs = [Connection(os.dup(fd), writable=fd != orders[0]) for fd in (orders[0], reports[1], 2)]
        given = (theirs, [*words[1:]], dict(env), Path.cwd())
        self._process = self.context.Process(target=_serve, args=given, daemon=True)  # type: ignore[attr-defined]
        self._process.start()
        for fd in (orders[0], reports[1]):
            os.close(fd)
        self.stdin, self.stdout = os.fdopen(orders[1], "wb"), os.fdopen(reports[0], "rb")
        self.pid, self.kill = self._process.pid, self._process.kill

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired("worker", timeout or 0.0)
        return self._process.exitcode


@contextmanager
def forked_workers(context: BaseContext) -> Iterator[None]:
    """Fork workers instead of starting Python anew."""
    names = {name: getattr(subprocess, name) for name in ("PIPE", "TimeoutExpired")}
    ForkedWorker.context = context
    process.subprocess = SimpleNamespace(Popen=ForkedWorker, **names)  # type: ignore[assignment]
    try:
        yield
    finally:
        process.subprocess = subprocess


def _serve(
    pipes: Sequence[Connection], words: list[str], environment: Mapping[str, str], folder: Path
) -> None:
    for fd in ForkedWorker.ours:
        os.close(fd)
    for number, connection in enumerate(pipes):
        os.dup2(connection.fileno(), number)
        connection.close()
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.argv = words
    os.setsid()
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    process.serve()
