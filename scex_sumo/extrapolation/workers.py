"""Pool of worker processes: batches of a run, moments of a study.

libsumo runs one simulation per process. A worker that dies is replaced, and its task is done once more.

`concurrent.futures.ProcessPoolExecutor` breaks with one dead worker and hides its task.
"""

from __future__ import annotations

import os
import pickle
import queue
import resource
import subprocess
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from scex_sumo.base.errors import SimulationError, UsageError
from scex_sumo.base.files import TemporaryFolder

if TYPE_CHECKING:
    from scex_sumo.base.arrays import IntArray
    from scex_sumo.extrapolation.job import Job

TRIES = 2
MAX_PROCESSES = 1000
MIN_ADDRESS_SPACE = 3 * 10**9  # bytes; with less, libsumo or Arrow crash while they are loaded

T = TypeVar("T")
OnStep: TypeAlias = Callable[[int], None]
Work: TypeAlias = Callable[[], AbstractContextManager[Callable[[Any, OnStep], Any]]]
"""Opens what tasks share, such as a world; yields the function that does one task."""
Report: TypeAlias = tuple[Literal["step", "done", "failed"], Any]

_DIED = (EOFError, OSError, pickle.UnpicklingError)  # raised by the pipes of a process that has died
_MAIN = str(Path(__file__).with_name("__main__.py"))
# One thread each: the processes are the parallelism.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class WorkersDied(Exception):
    """Two workers died over the same task: which one, and how each ended."""


class Workers:
    """Processes that do tasks; a context manager. They start at once."""

    def __init__(self, processes: int) -> None:
        """Start all but one of the processes; this process is the other."""
        if not 1 <= processes <= MAX_PROCESSES:
            raise UsageError(f"--workers: got {processes}, needs 1 to {MAX_PROCESSES}")
        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY and limit < MIN_ADDRESS_SPACE:
            raise SimulationError(
                f"ulimit -v leaves each process {limit / 1e9:.1f} GB of address space, libsumo with Arrow "
                f"needs {MIN_ADDRESS_SPACE / 1e9:.1f} GB; raise it, or limit resident memory instead"
            )
        self.processes = processes
        self.deaths: list[str] = []
        """One phrase for each worker that died and was replaced."""
        self._folder = TemporaryFolder()
        self._workers = [_Worker(self._folder.name) for _ in range(processes - 1)]

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill the workers, whatever they do."""
        for worker in self._workers:
            worker.kill()
        for worker in self._workers:
            worker.join()
        self._folder.cleanup()

    def run(
        self, job: Job, batches: Sequence[IntArray], *, on_step: OnStep | None = None
    ) -> Iterator[IntArray]:
        """Run batches of children, here and in the workers, and save their parts in the result folder.

        Args:
            on_step: called with a number of children when they have made a step.

        Yields:
            The children of each finished batch, in any order.

        Raises:
            SimulationError: two workers died over the same batch.
            Exception: whatever a batch raises.
        """
        from scex_sumo.extrapolation.job import batch_runner

        left, reports = deque(batches), queue.SimpleQueue[Report]()
        slots = sorted({int(slot) for batch in batches for slot in job.slots(batch)})
        work, tick = partial(batch_runner, job, slots), on_step or (lambda children: None)
        busy = self._workers[: max(len(batches) - 1, 0)]
        packed = _pickled(work) if busy else b""
        for worker in busy:
            worker.thread.submit(self._share, worker, packed, left, reports)
        unfinished = len(batches)

        def read() -> Iterator[IntArray]:
            nonlocal unfinished
            kind, content = reports.get()
            if kind == "step":
                tick(content)
            elif kind == "failed":
                raise content
            else:
                unfinished -= 1
                yield content

        try:
            with work() as run_here:
                for batch in _taken(left):
                    yield run_here(batch, tick)
                    unfinished -= 1
                    while not reports.empty():
                        yield from read()
            while unfinished:
                yield from read()
        finally:
            left.clear()

    def _share(
        self, worker: _Worker, work: bytes, left: deque[IntArray], reports: queue.SimpleQueue[Report]
    ) -> None:

        def tick(children: int) -> None:
            reports.put(("step", children))

        try:
            self._try_twice(worker, "before its first futures", partial(worker.open, work))
            for batch in _taken(left):
                where = f"during futures {int(batch[0])} to {int(batch[-1])}"
                order = partial(worker.do, work, batch, tick)
                reports.put(("done", self._try_twice(worker, where, order)))
        except WorkersDied as died:
            where, ends = died.args
            reason = f"a worker died twice {where} ({ends[-1]})"
            remedy = "finished futures are kept; run the same command again to go on"
            reports.put(("failed", SimulationError(f"{reason}; {remedy}")))
        except BaseException as error:  # raised again where the batches are awaited
            reports.put(("failed", error))

    def run_each(
        self, work: Work, tasks: Iterable[T], *, where: Callable[[T], str]
    ) -> Iterator[tuple[T, Future[Any]]]:
        """Do tasks in the workers alone; a task is taken when a worker is free.

        Args:
            where: describes a task, should its worker die.

        Yields:
            Each finished task with its future, which raises `WorkersDied` if two workers died.
        """
        waiting, idle, packed = iter(tasks), deque(self._workers), _pickled(work)
        running: dict[Future[Any], tuple[T, _Worker]] = {}
        while True:
            while idle and (task := next(waiting, None)) is not None:
                worker = idle.popleft()
                order = partial(worker.do, packed, task, lambda children: None)
                running[worker.thread.submit(self._try_twice, worker, where(task), order)] = task, worker
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, worker = running.pop(future)
                idle.append(worker)
                yield task, future

    def submit(
        self, function: Callable[..., Any], *, where: str, on_step: OnStep | None = None
    ) -> Future[Any] | None:
        """Let a worker call a function before its next task; return its future, or None without workers.

        With ``on_step`` the function gets a function of one number, which calls ``on_step`` here.
        """
        if not self._workers:
            return None
        worker = self._workers[-1]
        work = _pickled(partial(_calling, function, on_step is not None))
        order = partial(worker.do, work, None, on_step or (lambda children: None))
        return worker.thread.submit(self._try_twice, worker, where, order)

    def _try_twice(self, worker: _Worker, where: str, order: Callable[[], Report]) -> Any:
        """Return the result of an order, from a second process if the first one dies."""
        reasons: list[str] = []
        while len(reasons) < TRIES:
            try:
                kind, content = order()
            except _DIED:
                reasons.append(worker.exit_reason())
            else:
                if kind == "failed":
                    raise content[0] from content[1]
                return content
            worker.start()  # EOFError if the workers have been closed
            if len(reasons) == 1:
                self.deaths.append(f"a worker died {where} ({reasons[0]}) and was replaced")
        raise WorkersDied(where, reasons)


def succeeded(future: Future[Any]) -> bool:
    """Wait for a submitted function; return False if workers died of it."""
    with suppress(WorkersDied):
        future.result()
        return True
    return False


@contextmanager
def _calling(function: Callable[..., Any], tells: bool) -> Iterator[Callable[[Any, OnStep], Any]]:
    yield lambda task, on_step: function(on_step) if tells else function()


def _taken(left: deque[IntArray]) -> Iterator[IntArray]:
    with suppress(IndexError):
        while True:
            yield left.popleft()


def in_other_process(
    function: Callable[..., T], *, where: str, died: str, on_step: OnStep | None = None
) -> T:
    """Call a function in another process, and return what it returns; ``on_step`` as of `Workers.submit`.

    Raises:
        SimulationError: two processes died over it; ``died`` tells so.
    """
    with Workers(2) as workers:
        future = workers.submit(function, where=where, on_step=on_step)
        assert future is not None
        try:
            result: T = future.result()
        except WorkersDied as error:
            raise SimulationError(f"{died} ({error.args[1][-1]})") from None
    return result


class _Worker:
    def __init__(self, folder: str) -> None:
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="scex-worker")
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
                [sys.executable, _MAIN],
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
        return self._answer(lambda children: None)

    def do(self, work: bytes, task: Any, on_step: OnStep) -> Report:
        """Return the report when a task is done or has failed."""
        report = self.open(work)
        if report[0] == "failed":
            return report
        self._send(("task", task))
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
        load_sumo()

    def report(kind: str, content: Any) -> None:
        _write(reports, (kind, content))

    with suppress(EOFError, BrokenPipeError), ExitStack() as opened:
        while True:
            kind, content = pickle.load(sys.stdin.buffer)
            try:
                if kind == "open":
                    opened.close()
                    sys.path[:], packed = content
                    do = opened.enter_context(pickle.loads(packed)())
                    report("done", None)
                else:
                    report("done", do(content, partial(report, "step")))
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


def _pickled(content: Any) -> bytes:
    """Pickle; classes of the user's script by value, because a worker does not run it."""
    try:
        packed = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError):
        packed = b"__main__"
    if b"__main__" not in packed:
        return packed
    import cloudpickle

    try:
        by_value: bytes = cloudpickle.dumps(content)
    except Exception as error:  # of a user's object
        raise UsageError(f"a model or metric cannot be sent to workers ({error}); use --workers 1") from None
    return by_value
