"""Worker process: another one that works for this one, over pickles on its standard streams.

A process holds one simulation of libsumo, so that more of them need more interpreters; one that hangs on the
pipes of this process ends with it, whatever ends that.

Why neither joblib with loky nor `concurrent.futures`: workers shall start while the first process still
reads its input, that process takes its share of the work, and one worker can die without taking the pool
along or hiding whose work it was. loky, which we used before, also restarted workers that had grown large,
with a warning.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from typing import IO, Any

from scex_sumo.extrapolation.workers.forked import Forked, can_fork, keep_to_this, let_go

DIED = (EOFError, OSError, pickle.UnpicklingError)
"""What `WorkerProcess.send` and `WorkerProcess.receive` raise where the process has died."""

_START = "import sys; sys.path[:] = {path!r}; from {module} import serve; serve()"
# One thread each: the processes are the parallelism.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkerProcess:
    """One more process, as this one sees it: a copy of this one where that has one thread, else another
    interpreter.
    """

    def __init__(self, module: str, folder: str) -> None:
        """Start the process.

        Args:
            module: the module whose function ``serve`` the process runs, with `served_streams`.
            folder: where its temporary files lie, so that the caller can remove what a killed one leaves.
        """
        self._module, self._folder = module, folder
        self._ending = threading.Lock()
        self._ended = False
        self.start()

    def start(self) -> None:
        """Start the process, anew if there was one.

        Raises:
            EOFError: it has been ended for good.
        """
        with self._ending:
            self._raise_if_ended()
            self._process = Forked(self._module, self._folder) if can_fork() else self._interpreter()
            keep_to_this(self._process.stdin, self._process.stdout)

    def _interpreter(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-c", _START.format(path=sys.path, module=self._module)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **_ONE_THREAD, "TMPDIR": self._folder},
            start_new_session=True,  # Ctrl-C is for the process that the user started, which ends these
        )

    def send(self, content: Any) -> None:
        """Send it something; raises one of `DIED` where it has died."""
        assert self._process.stdin is not None
        try:
            write(self._process.stdin, content)
        except ValueError:
            self._raise_if_ended()
            raise

    def receive(self) -> Any:
        """Wait for what it sends; raises one of `DIED` where it dies."""
        assert self._process.stdout is not None
        try:
            return pickle.load(self._process.stdout)
        except ValueError:
            self._raise_if_ended()
            raise

    def _raise_if_ended(self) -> None:
        """Another thread may close the pipes at any time, which the streams take for a wrong value."""
        if self._ended:
            raise EOFError from None

    def exit_reason(self) -> str:
        """How it ended, after one of `DIED`: ``signal 9``, ``exit status 3``."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=1)
        self._process.kill()
        status = self.wait_for_exit()
        return f"signal {-status}" if status < 0 else f"exit status {status}"

    def kill(self) -> None:
        """End it for good, whatever it is at; a thread may be waiting for its answer."""
        with self._ending:
            self._ended = True
        self._process.kill()

    def wait_for_exit(self) -> int:
        """Exit status of one that was killed, whose pipes are closed."""
        status = self._process.wait()
        let_go(self._process.stdin, self._process.stdout)
        return status


def served_streams() -> tuple[IO[bytes], IO[bytes]]:
    """In a worker: where tasks come in, and where answers go, apart from whatever is printed."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what SUMO prints shall not get among the answers
    return sys.stdin.buffer, answers


def write(stream: IO[bytes], content: Any) -> None:
    """Send a pickle."""
    pickle.dump(content, stream, protocol=pickle.HIGHEST_PROTOCOL)
    stream.flush()


def pickled(content: Any) -> bytes:
    """Pickle; classes of the user's own script by value, since a worker does not run the script."""
    try:
        packed = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError):
        packed = b"__main__"
    if b"__main__" not in packed:
        return packed
    import cloudpickle

    by_value: bytes = cloudpickle.dumps(content)
    return by_value
