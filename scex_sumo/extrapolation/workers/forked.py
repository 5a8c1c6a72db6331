"""Forked process: a copy of this one that serves on two pipes, with all that is imported already.

Only a process of one thread may be copied: what another thread holds would stay held in the copy for ever.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from subprocess import TimeoutExpired
from typing import IO

_THREADS = Path("/proc/self/task")
_KNOWS_FORKS = "jemalloc_bg_thd"  # Arrow's allocator, which goes on in a copy
_open: set[int] = set()  # this process's ends of pipes, which no copy may keep open


def can_fork() -> bool:
    """Whether this process can be copied: it has no other thread. Where that cannot be told it has some."""
    if threading.active_count() > 1 or not _THREADS.is_dir():
        return False
    names = [(task / "comm").read_text().strip() for task in _THREADS.iterdir()]
    return len([name for name in names if name != _KNOWS_FORKS]) == 1


def keep_to_this(*streams: IO[bytes] | None) -> None:
    """Pipes of this process that copies made later close: who waits at the other end waits for this one."""
    _open.update(stream.fileno() for stream in streams if stream is not None)


def let_go(*streams: IO[bytes] | None) -> None:
    """Close pipes that were kept to this process."""
    for stream in streams:
        if stream is not None and not stream.closed:
            _open.discard(stream.fileno())
            with suppress(OSError):  # what nobody read any more
                stream.close()


class Forked:
    """A copy of this process, with the face of a `subprocess.Popen`.

    Attributes:
        stdin: what it reads.
        stdout: what it answers.
    """

    def __init__(self, module: str, folder: str) -> None:
        """Copy this process; see `can_fork`.

        Args:
            module: the module whose function ``serve`` the copy runs on its standard streams.
            folder: where its temporary files lie.
        """
        theirs_in, ours_in = os.pipe()
        ours_out, theirs_out = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        gc.freeze()  # or the first collection in the copy would copy all pages
        self._pid = os.fork()
        if self._pid == 0:
            _serve(module, folder, theirs_in, theirs_out, (ours_in, ours_out))
        gc.unfreeze()
        os.close(theirs_in)
        os.close(theirs_out)
        self.stdin: IO[bytes] = os.fdopen(ours_in, "wb")
        self.stdout: IO[bytes] = os.fdopen(ours_out, "rb")
        self._status: int | None = None
        self._waiting = threading.Lock()

    def kill(self) -> None:
        """End it, whatever it is at."""
        with self._waiting:
            if self._poll() is None:
                os.kill(self._pid, signal.SIGKILL)

    def wait(self, timeout: float | None = None) -> int:
        """Exit status, negative for a signal.

        Raises:
            TimeoutExpired: it has not ended by then, s.
        """
        begin = time.monotonic()
        while True:
            with self._waiting:
                if (status := self._poll()) is not None:
                    return status
            if timeout is not None and time.monotonic() - begin > timeout:
                raise TimeoutExpired("worker", timeout)
            time.sleep(0.002)

    def _poll(self) -> int | None:
        if self._status is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            self._status = os.waitstatus_to_exitcode(status) if pid else None
        return self._status


def _serve(module: str, folder: str, orders: int, answers: int, ours: tuple[int, ...]) -> None:
    """What the copy does until its orders end; never returns."""
    status = 1
    try:
        os.setsid()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        for end in (*ours, *_open):
            os.close(end)
        os.dup2(orders, 0)
        os.dup2(answers, 1)
        os.close(orders)
        os.close(answers)
        sys.stdin = open(0, closefd=False)  # noqa: SIM115
        os.environ["TMPDIR"] = tempfile.tempdir = folder
        importlib.import_module(module).serve()
        status = 0
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else 1
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stderr.flush()
        os._exit(status)
