"""Forked cases: one command each in a process of its own, with limits, and a verdict on how it ended."""

from __future__ import annotations

import gc
import importlib
import os
import resource
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

LIMIT_S, LIMIT_BYTES = 60.0, 2 << 30
"""Of processor time, so that other work on the machine is no hang; of wall time ten times as much."""
MAPPED_BYTES = 4 << 30
"""More address space than is used, for threads and libraries reserve it."""
LONGEST_LINE = 700
CACHE = "cache"
"""Folder in a case's folder that its process takes for the user's caches, if it is there."""
IMPORTED = "imported.txt"
"""File in a case's folder: the modules that its process imported."""


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a command ended.

    Attributes:
        verdict: ``result``, ``one line``, or what is wrong: ``traceback``, ``died``, ``hang``, ``memory``,
            ``words`` (no line, several, or a long one), ``status``.
        status: exit status; minus the signal of a process that died.
        said: the end of standard error.
        seconds: wall time.
    """

    verdict: str
    status: int
    said: str
    seconds: float

    @property
    def fine(self) -> bool:
        """Whether it is how a command may end."""
        return self.verdict in ("result", "one line")


def run_forked(arguments: Sequence[str], folder: Path) -> Ended:
    """Run a command of scex-sumo in a forked process, in a folder."""
    started = time.monotonic()
    errors = folder / "stderr.txt"
    future = os.fork()
    if future == 0:
        _run(arguments, folder, errors)
    status, usage, hang = _wait(future, started)
    _learn(folder / IMPORTED)
    said = errors.read_text(errors="replace")
    code = -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)
    verdict = "hang" if hang else _verdict(code, said, usage.ru_maxrss * 1024)
    return Ended(verdict=verdict, status=code, said=said[-2000:], seconds=time.monotonic() - started)


def _run(arguments: Sequence[str], folder: Path, errors: Path) -> None:
    """The future: never returns."""
    status, before = 70, set(sys.modules)
    try:
        os.setsid()
        os.chdir(folder)
        if (folder / CACHE).is_dir():
            os.environ["XDG_CACHE_HOME"] = str(folder / CACHE)
        for number, target in ((1, folder / "stdout.txt"), (2, errors)):
            os.dup2(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1) for number in (1, 2))
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        size += MAPPED_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        from scex_sumo.cli import main

        sys.argv = ["scex-sumo", *arguments]
        main()
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        with suppress(OSError, MemoryError):
            (folder / IMPORTED).write_text("\n".join(name for name in sys.modules if name not in before))
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _learn(imported: Path) -> None:
    """Import what a case had to import, so that the cases after it need not."""
    if imported.exists():
        for name in imported.read_text().split():
            with suppress(Exception):
                importlib.import_module(name)
        gc.freeze()


def _wait(future: int, started: float) -> tuple[int, resource.struct_rusage, bool]:
    hang = False
    while True:
        ended, status, usage = os.wait4(future, os.WNOHANG)
        if ended:
            return status, usage, hang
        if not hang and (_processor_s(future) > LIMIT_S or time.monotonic() - started > 10 * LIMIT_S):
            hang = True
            os.killpg(future, signal.SIGKILL)
        time.sleep(0.01)


def _processor_s(process: int) -> float:
    """Return the processor time of a process and its ended children, s."""
    times = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:15]
    return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")


def _verdict(code: int, said: str, peak_bytes: int) -> str:
    if "Traceback (most recent call last)" in said or code == 70:
        return "traceback"
    if code < 0:
        return "died"
    if peak_bytes > LIMIT_BYTES:
        return "memory"
    told = ("note: ", "warning: ", "waiting up to ")  # the last one on a slow machine
    lines = [line for line in said.splitlines() if line.strip() and not line.startswith(told)]
    if max((len(line) for line in said.splitlines()), default=0) > LONGEST_LINE:
        return "words"
    if code == 0:
        return "result" if not lines else "words"
    if code not in (1, 2):
        return "status"
    return "one line" if len(lines) == 1 and lines[0].startswith("error: ") else "words"
