"""Who runs the seeds: processes of this machine. Each is one of libsumo's, and dies alone."""

from __future__ import annotations

import dataclasses
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from scex_sumo.ranking.seeds import SeedRef
from scex_sumo.ranking.work import Parcel, SeedPart, SeedTask, run_seed
from scex_sumo.scene import SeedScene

TRIES = 2
_START = "import sys; sys.path[:] = {path!r}; from scex_sumo.ranking.crew import serve; serve()"
# One thread each: the processes are the parallelism.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """A task on its way to a worker, with the road that it needs."""

    ref: SeedRef
    task: SeedTask
    parcel: Parcel

    def scene(self) -> SeedScene:
        """The seed scene with its road."""
        return dataclasses.replace(self.task.scene, road=self.parcel.road())


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What became of an order.

    Attributes:
        order: what was asked for.
        part: the children, or None where they failed.
        reason: why.
        died: a worker died of it, twice.
    """

    order: Order
    part: SeedPart | None = None
    reason: str = ""
    died: bool = False


class Crew(Protocol):
    """Workers, wherever they are."""

    @property
    def notes(self) -> list[str]:
        """What the user should know of them."""

    def run(self, orders: Iterable[Order]) -> Iterator[Outcome]:
        """Run orders as they come, a few at a time; their outcomes in the order in which they finish."""

    def close(self) -> None:
        """End the workers, whatever they do."""


def outcome(order: Order, result: SeedPart | str) -> Outcome:
    """The outcome of an order whose worker answered."""
    if isinstance(result, str):
        return Outcome(order=order, reason=result)
    return Outcome(order=order, part=result)


class Processes:
    """Worker processes of this machine, one seed at a time each; what a dead one had is done again once."""

    def __init__(self, count: int) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="scex-rank-", ignore_cleanup_errors=True)
        self._workers = [_Worker(self._folder.name) for _ in range(count)]
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="scex-rank")

    @property
    def notes(self) -> list[str]:
        """See `Crew`."""
        return []

    def run(self, orders: Iterable[Order]) -> Iterator[Outcome]:
        """See `Crew`."""
        waiting, idle = iter(orders), deque(self._workers)
        running: dict[Future[Outcome], _Worker] = {}
        while True:
            while idle and (order := next(waiting, None)) is not None:
                worker = idle.popleft()
                running[self._threads.submit(worker.work, order)] = worker
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                idle.append(running.pop(future))
                yield future.result()

    def close(self) -> None:
        """See `Crew`."""
        for worker in self._workers:
            worker.kill()
        self._threads.shutdown()
        for worker in self._workers:
            worker.bury()
        self._folder.cleanup()


class _Worker:
    """A worker process, as this one sees it.

    It is an interpreter of its own, since a process holds one simulation of libsumo, and talks over its
    standard streams, so that it ends with this process, whatever ends that.
    """

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._ending = threading.Lock()
        self._ended = False
        self._start()

    def _start(self) -> None:
        with self._ending:
            if self._ended:
                raise EOFError
            self._process = subprocess.Popen(
                [sys.executable, "-c", _START.format(path=sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                # What a killed worker leaves behind lies where this process removes it.
                env={**os.environ, **_ONE_THREAD, "TMPDIR": self._folder},
                start_new_session=True,  # Ctrl-C is for the process that the user started, which ends these
            )

    def work(self, order: Order) -> Outcome:
        """Have it run an order; where it dies, once more."""
        fates = []
        for _ in range(TRIES):
            try:
                return outcome(order, self._ask(order))
            except (EOFError, OSError, pickle.UnpicklingError):
                fates.append(self._fate())
                with suppress(EOFError):
                    self._start()
        reason = f"its worker died {TRIES} times ({', '.join(fates)}): out of memory, killed, or a crash"
        return Outcome(order=order, reason=reason, died=True)

    def _ask(self, order: Order) -> SeedPart | str:
        orders, answers = self._process.stdin, self._process.stdout
        assert orders is not None and answers is not None
        pickle.dump((order.task, order.parcel), orders, protocol=pickle.HIGHEST_PROTOCOL)
        orders.flush()
        answer: SeedPart | str = pickle.load(answers)
        return answer

    def _fate(self) -> str:
        """How it ended."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=1)
        self._process.kill()
        status = self.bury()
        return f"signal {-status}" if status < 0 else f"exit status {status}"

    def kill(self) -> None:
        """End it for good, whatever it is at; somebody may be waiting for its answer."""
        with self._ending:
            self._ended = True
        self._process.kill()

    def bury(self) -> int:
        """Clear away what is left of it when nobody waits for it; returns its exit status."""
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with suppress(OSError):  # what was never sent
                    stream.close()
        return self._process.wait()


def serve() -> None:
    """What a worker process does: run what comes in on standard input until it closes."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what SUMO prints shall not get among the answers
    orders = sys.stdin.buffer
    with suppress(EOFError, BrokenPipeError):
        while True:
            pickle.dump(run_seed(*pickle.load(orders)), answers, protocol=pickle.HIGHEST_PROTOCOL)
            answers.flush()
