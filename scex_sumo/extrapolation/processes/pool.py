"""Pool of worker processes: batches of a run, moments of a study, functions.

libsumo runs one simulation per process. A worker that dies is replaced, and its task is done once more.

`concurrent.futures.ProcessPoolExecutor` breaks with one dead worker and hides its task.
"""

from __future__ import annotations

import math
import pickle
import queue
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from typing import Any, TypeAlias, TypeVar

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.sending import pickled
from scex_sumo.extrapolation.processes.process import OnStep, Report, WorkerProcess

TRIES = 2
BATCH_S = 0.4  # of batches that are worth their fixed cost

T = TypeVar("T")
Work: TypeAlias = Callable[[], AbstractContextManager[Callable[[Any, OnStep], Any]]]
"""Opens what tasks share, such as a world; yields the function that does one task."""

_OUT_OF_TIME = f"signal {int(signal.SIGPROF)}"  # of a task that limits its own processor time
_DIED = (EOFError, OSError, pickle.UnpicklingError)  # raised by the pipes of a process that has died


class WorkersDied(Exception):
    """Two workers died over the same task: which one, and how each ended."""


class Pool:
    """Worker processes; a context manager. They start at once.

    ``simulates``: they load what batches need before the first one comes.
    """

    def __init__(self, processes: int, *, simulates: bool = False) -> None:
        self.deaths: list[str] = []
        """One phrase for each worker that died and was replaced."""
        self._folder = TemporaryFolder()
        self._workers = [WorkerProcess(self._folder.name, simulates) for _ in range(processes)]

    def __enter__(self) -> Pool:
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

    def run(self, work: Work, batches: Sequence[IntArray], tick: OnStep, *, together: int) -> None:
        """Run batches of futures, here and in the workers; see `Workers.run`."""
        left, reports = _Batches(batches, 1 + len(self._workers), together), queue.SimpleQueue[Report]()
        busy = self._workers[: max(len(batches) - 1, 0)]
        packed = pickled(work) if busy else b""
        for worker in busy:
            worker.thread.submit(self._share, worker, packed, left, reports)
        unfinished = sum(map(len, batches))

        def read() -> None:
            nonlocal unfinished
            kind, content = reports.get()
            if kind == "step":
                tick(content)
            elif kind == "failed":
                raise content
            else:
                unfinished -= len(content)

        try:
            with work() as run_here:
                for batch in left.taken():
                    run_here(batch, tick)
                    unfinished -= len(batch)
                    while not reports.empty():
                        read()
            while unfinished:
                read()
        finally:
            left.clear()

    def _share(
        self, worker: WorkerProcess, work: bytes, left: _Batches, reports: queue.SimpleQueue[Report]
    ) -> None:

        def tick(futures: int) -> None:
            reports.put(("step", futures))

        if not left:
            return
        try:
            self._try_twice(worker, "before its first futures", partial(worker.open, work))
            for batch in left.taken():
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
        waiting, idle, packed = iter(tasks), deque(self._workers), pickled(work)
        running: dict[Future[Any], tuple[T, WorkerProcess]] = {}
        while True:
            while idle and (task := next(waiting, None)) is not None:
                worker = idle.popleft()
                order = partial(worker.do, packed, task, lambda futures: None)
                running[worker.thread.submit(self._try_twice, worker, where(task), order)] = task, worker
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, worker = running.pop(future)
                idle.append(worker)
                yield task, future

    def submit(
        self, function: Callable[..., Any], *, where: str, on_step: OnStep | None = None
    ) -> Future[Any]:
        """Let a worker call a function before its next task; return its future.

        With ``on_step`` the function gets a function of one number, which calls ``on_step`` here.
        """
        worker = self._workers[-1]
        work = pickled(partial(_calling, function, on_step is not None))
        order = partial(worker.do, work, None, on_step or (lambda futures: None))
        return worker.thread.submit(self._try_twice, worker, where, order)

    def _try_twice(self, worker: WorkerProcess, where: str, order: Callable[[], Report]) -> Any:
        """Return the result of an order, from a second process if the first one dies."""
        reasons: list[str] = []
        while len(reasons) < TRIES and _OUT_OF_TIME not in reasons:
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


@contextmanager
def _calling(function: Callable[..., Any], tells: bool) -> Iterator[Callable[[Any, OnStep], Any]]:
    yield lambda task, on_step: function(on_step) if tells else function()


class _Batches:
    """Batches that no process has taken yet.

    A process takes its share of those that are left, at most ``together``, and quick ones together: so it
    begins with large batches, and small ones are left for a process that comes late.
    """

    def __init__(self, batches: Sequence[IntArray], processes: int, together: int) -> None:
        self._left, self._processes, self._together = deque(batches), processes, together
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._left)

    def clear(self) -> None:
        """Leave none."""
        self._left.clear()

    def taken(self) -> Iterator[IntArray]:
        """Yield the batches that a process takes, one after the other."""
        quick = 1  # batches that take `BATCH_S`
        while True:
            with self._lock:
                share = max(math.ceil(len(self._left) / self._processes), quick)
                count = min(share, self._together, len(self._left))
                taken = [self._left.popleft() for _ in range(count)]
            if not taken:
                return
            begin = time.perf_counter()
            yield np.concatenate(taken)
            quick = int(BATCH_S * count / max(time.perf_counter() - begin, 1e-9))


def in_other_process(
    function: Callable[..., T], *, where: str, died: str, endless: str = "", on_step: OnStep | None = None
) -> T:
    """Call a function in another process, and return what it returns; ``on_step`` as of `Pool.submit`.

    Raises:
        SimulationError: two processes died over it, or one out of its time; ``died`` or ``endless`` tells so.
    """
    with Pool(1) as pool:
        future = pool.submit(function, where=where, on_step=on_step)
        try:
            result: T = future.result()
        except WorkersDied as error:
            last = error.args[1][-1]
            raise SimulationError(endless if last == _OUT_OF_TIME else f"{died} ({last})") from None
    return result
