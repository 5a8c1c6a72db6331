"""Pool of worker processes, which start while this one still reads: batches of a run, moments of a ranking.

Whoever is free takes the next task, so that nobody waits for another, and what a task gives depends on
nothing but itself. A worker that dies is replaced, and the task that it had is done again once.
"""

from __future__ import annotations

import queue
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

from scex_sumo.errors import SimulationError, UsageError
from scex_sumo.extrapolation.workers import serving
from scex_sumo.extrapolation.workers.process import DIED, WorkerProcess, pickled
from scex_sumo.files import TemporaryFolder

if TYPE_CHECKING:
    from scex_sumo.arrays import IntArray
    from scex_sumo.extrapolation.job import Job

TRIES = 2
MOST_PROCESSES = 1000

T = TypeVar("T")
OnStep: TypeAlias = Callable[[int], None]
Work: TypeAlias = Callable[[], AbstractContextManager[Callable[[Any, OnStep], Any]]]
"""Opens what tasks have in common, such as a world; gives the function that does a task."""
Report: TypeAlias = tuple[Literal["step", "done", "failed"], Any]


class WorkersDied(Exception):
    """All workers died that tried one task: what they were at, and how each ended."""


class Workers:
    """Processes that do tasks; a context manager. They start at once, unasked."""

    def __init__(self, processes: int) -> None:
        """Start all but one of the processes; this one is the other.

        Args:
            processes: how many there shall be.

        Raises:
            UsageError: fewer than one, or more than a thousand.
        """
        if not 1 <= processes <= MOST_PROCESSES:
            raise UsageError(f"--workers: got {processes}, needs 1 to {MOST_PROCESSES}")
        self.processes = processes
        self.deaths: list[str] = []
        """One phrase for each task whose worker died and was replaced."""
        self._folder = TemporaryFolder()
        self._workers = [_Worker(self._folder.name) for _ in range(processes - 1)]

    def __enter__(self) -> Workers:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the workers at once, whatever they are at; may be called again."""
        for worker in self._workers:
            worker.kill()
        for worker in self._workers:
            worker.thread.shutdown(cancel_futures=True)
            worker.wait_for_exit()
        self._folder.cleanup()

    def run(
        self, job: Job, batches: Sequence[IntArray], *, on_step: OnStep | None = None
    ) -> Iterator[IntArray]:
        """Run batches of children, here and in the workers, and keep their parts in the result folder.

        Args:
            job: the run.
            batches: numbers of the children of each batch.
            on_step: called with a number of children when they have made a step, in any process.

        Yields:
            The children of each batch when it is finished, in any order.

        Raises:
            SimulationError: a worker died twice over the same batch.
            Exception: whatever a batch raises, wherever it runs.
        """
        from scex_sumo.extrapolation.job import batch_runner

        left, reports = deque(batches), queue.SimpleQueue[Report]()
        slots = sorted({int(slot) for batch in batches for slot in job.slots(batch)})
        work, tick = partial(batch_runner, job, slots), on_step or (lambda children: None)
        busy = self._workers[: max(len(batches) - 1, 0)]
        packed = pickled(work) if busy else b""
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
        """Give a worker batches as long as there are any, the first when it is ready for it."""

        def tick(children: int) -> None:
            reports.put(("step", children))

        try:
            self._twice(worker, "before its first children", partial(worker.open, work))
            for batch in _taken(left):
                where = f"over children {int(batch[0])} to {int(batch[-1])}"
                reports.put(("done", self._twice(worker, where, partial(worker.do, work, batch, tick))))
        except WorkersDied as died:
            where, ends = died.args
            reason = f"a worker died twice {where} ({ends[-1]})"
            left_over = "finished children are kept, the same command goes on"
            reports.put(("failed", SimulationError(f"{reason}; {left_over}")))
        except BaseException as error:  # raised again where the batches are waited for
            reports.put(("failed", error))

    def run_each(
        self, work: Work, tasks: Iterable[T], *, where: Callable[[T], str]
    ) -> Iterator[tuple[T, Future[Any]]]:
        """Do tasks in the workers alone, each taken when there is a worker for it.

        Args:
            work: does one.
            tasks: asked for in the caller's thread.
            where: the words for one, should its worker die.

        Yields:
            Each with its finished future, in the order in which they finish; that of a task of which two
            workers died raises `WorkersDied`.
        """
        waiting, idle, packed = iter(tasks), deque(self._workers), pickled(work)
        running: dict[Future[Any], tuple[T, _Worker]] = {}
        while True:
            while idle and (task := next(waiting, None)) is not None:
                worker = idle.popleft()
                order = partial(worker.do, packed, task, lambda children: None)
                running[worker.thread.submit(self._twice, worker, where(task), order)] = task, worker
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task, worker = running.pop(future)
                idle.append(worker)
                yield task, future

    def beside(self, do: Callable[[], Any], *, where: str) -> Future[Any] | None:
        """Have a worker do something before it takes its next task, whatever this process does meanwhile.

        Args:
            do: called in the worker.
            where: the words for it, should the worker die.

        Returns:
            Its result to come, which raises `WorkersDied` where two workers died of it; None without workers.
        """
        if not self._workers:
            return None
        worker = self._workers[-1]
        order = partial(worker.do, pickled(partial(_calling, do)), None, lambda children: None)
        worker.beside = worker.thread.submit(self._twice, worker, where, order)
        return worker.beside

    @property
    def occupied(self) -> int:
        """How many workers do something beside."""
        return sum(worker.beside is not None and not worker.beside.done() for worker in self._workers)

    def _twice(self, worker: _Worker, where: str, order: Callable[[], Report]) -> Any:
        """What an order gives, from another process where the first one dies; raises what it raised."""
        reasons: list[str] = []
        while len(reasons) < TRIES:
            try:
                kind, content = order()
            except DIED:
                reasons.append(worker.exit_reason())
            else:
                if kind == "failed":
                    raise content[0] from content[1]
                return content
            worker.start()  # EOFError where the workers have been closed
            if len(reasons) == 1:
                self.deaths.append(f"a worker died {where} ({reasons[0]}) and was replaced")
        raise WorkersDied(where, reasons)


def ended_well(done: Future[Any]) -> bool:
    """Wait for what was done beside; False where workers died of it, and raises what it raised."""
    with suppress(WorkersDied):
        done.result()
        return True
    return False


@contextmanager
def _calling(do: Callable[[], Any]) -> Iterator[Callable[[Any, OnStep], Any]]:
    """Work of one task, which is to call a function."""
    yield lambda task, on_step: do()


def _taken(left: deque[IntArray]) -> Iterator[IntArray]:
    """Batches that nobody else has taken, as long as there are any."""
    with suppress(IndexError):
        while True:
            yield left.popleft()


class _Worker(WorkerProcess):
    """A worker process, to which one thread gives tasks.

    Attributes:
        thread: does what is submitted to it, one after the other.
        beside: what it was given last to do beside.
    """

    def __init__(self, folder: str) -> None:
        super().__init__(serving.__name__, folder)
        self.thread = ThreadPoolExecutor(1, thread_name_prefix="scex-worker")
        self.beside: Future[Any] | None = None

    def start(self) -> None:
        """Start the process, which has nothing open."""
        self._work: bytes | None = None
        super().start()

    def open(self, work: bytes) -> Report:
        """Its report when it is ready for the tasks of a work. Raises one of `DIED` where it dies."""
        if self._work is work:
            return "done", None
        # As the path is now, with the folder of the user's own models.
        self.send(("open", (sys.path, work)))
        self._work = work
        return self._answer(lambda children: None)

    def do(self, work: bytes, task: Any, on_step: OnStep) -> Report:
        """Its report when a task is done, or failed. Raises one of `DIED` where it dies."""
        report = self.open(work)
        if report[0] == "failed":
            return report
        self.send(("task", task))
        return self._answer(on_step)

    def _answer(self, on_step: OnStep) -> Report:
        while True:
            report: Report = self.receive()
            if report[0] != "step":
                self._work = self._work if report[0] == "done" else None
                return report
            on_step(report[1])
