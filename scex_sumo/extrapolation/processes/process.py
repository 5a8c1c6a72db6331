"""Worker process: its start, its pipes, its end; and the main function that runs in it."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

from scex_sumo.base.errors import OutOfTimeError, SimulationError, last_words
from scex_sumo.base.importing import import_arrow
from scex_sumo.base.sending import pickled, unpickled

OnStep: TypeAlias = Callable[[int], None]
Report: TypeAlias = tuple[Literal["step", "done", "failed"], Any]

SIMULATES = "simulates"
_MAIN = str(Path(__file__).with_name("__main__.py"))
# One thread each: the processes are the parallelism.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkerProcess:
    """Process that does one task after another, and the thread that waits for it."""

    def __init__(self, folder: str, simulates: bool = False) -> None:
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="scex-worker")
        self._command = [sys.executable, _MAIN, *([SIMULATES] if simulates else [])]
        self._folder = folder  # temporary files of a killed worker are removed with it
        self._starting = threading.Lock()
        self._ended = False
        self._process: subprocess.Popen[bytes] | None = None
        self.start()

    def start(self) -> None:
        """Start the process, or another one; raise EOFError if it has been killed for good."""
        with self._starting:
            if self._ended:
                raise EOFError
            self._close_pipes()
            self._work: bytes | None = None
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **_ONE_THREAD, "TMPDIR": self._folder},
                start_new_session=True,  # Ctrl-C is for the process that the user started
            )

    def open(self, work: bytes) -> Report:
        """Return the report when the process is ready for a work; raise one of `_DIED` if it dies."""
        if self._work is work:
            return "done", None
        self._send(("open", (sys.path, work)))  # the current path, with the folder of the user's models
        self._work = work
        return self._answer(lambda futures: None)

    def do(self, work: bytes, task: Any, on_step: OnStep) -> Report:
        """Return the report when a task is done or has failed."""
        report = self.open(work)
        if report[0] == "failed":
            return report
        self._send(("task", pickled(task)))
        return self._answer(on_step)

    def _send(self, content: Any) -> None:
        assert self._process is not None and self._process.stdin is not None
        _write(self._process.stdin, content)

    def _answer(self, on_step: OnStep) -> Report:
        assert self._process is not None and self._process.stdout is not None
        while True:
            report: Report = pickle.load(self._process.stdout)
            if report[0] != "step":
                self._work = self._work if report[0] == "done" else None
                return report
            on_step(report[1])

    def exit_reason(self) -> str:
        """Return how the process ended: ``signal 9``, ``exit status 3``."""
        assert self._process is not None
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=1)
        self._process.kill()
        status = self._process.wait()
        return f"signal {-status}" if status < 0 else f"exit status {status}"

    def kill(self) -> None:
        """Kill the process for good."""
        with self._starting:
            self._ended = True
        if self._process is not None:
            self._process.kill()

    def join(self) -> None:
        """Wait for the end of the process."""
        self.thread.shutdown(cancel_futures=True)
        if self._process is not None:
            self._process.wait()
        self._close_pipes()

    def _close_pipes(self) -> None:
        if self._process is not None:
            for pipe in (self._process.stdin, self._process.stdout):
                with suppress(OSError):  # what the process read no more
                    assert pipe is not None
                    pipe.close()


def serve() -> None:
    """Do the tasks that come in on standard input until it closes: the main function of a worker."""
    reports = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # SUMO's prints do not get among the reports
    from scex_sumo.world.session import load_sumo

    with suppress(Exception):  # the first task reports it
        import_arrow()
        load_sumo()
        if SIMULATES in sys.argv:
            import scex_sumo.extrapolation.job  # noqa: F401  # loaded while the first batch is prepared

    def report(kind: str, content: Any) -> None:
        _write(reports, (kind, content))

    last_words.append(lambda words: report("failed", (OutOfTimeError(words), WorkerTraceback(""))))
    with suppress(EOFError, BrokenPipeError), ExitStack() as opened:
        while True:
            kind, content = pickle.load(sys.stdin.buffer)
            try:
                if kind == "open":
                    opened.close()
                    sys.path[:], packed = content
                    do = opened.enter_context(unpickled(packed)())
                    report("done", None)
                else:
                    report("done", do(unpickled(content), partial(report, "step")))
            except (EOFError, BrokenPipeError):
                raise
            except Exception as error:
                opened.close()
                report("failed", (_sendable(error), WorkerTraceback(traceback.format_exc())))


class WorkerTraceback(Exception):
    """Traceback of an error in a worker, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling runs the error's own code
        return SimulationError(f"a worker failed: {type(error).__name__}: {error}")
    return error


def _write(stream: Any, content: Any) -> None:
    pickle.dump(content, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()
