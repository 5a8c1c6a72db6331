"""Who runs the seeds: processes of this machine. Each is one of libsumo's, and dies alone."""

from __future__ import annotations

import dataclasses
import pickle
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from scex_sumo.extrapolation.helper_process import DIED, HelperProcess, served_streams, write
from scex_sumo.ranking.seeds import SeedRef
from scex_sumo.ranking.task import Parcel, SeedPart, SeedTask, run_seed
from scex_sumo.scene import SeedScene

TRIES = 2


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


class _Worker(HelperProcess):
    """A worker process, as this one sees it."""

    def __init__(self, folder: str) -> None:
        super().__init__(__name__, folder)

    def work(self, order: Order) -> Outcome:
        """Have it run an order; where it dies, once more."""
        fates = []
        for _ in range(TRIES):
            try:
                return outcome(order, self._ask(order))
            except DIED:
                fates.append(self.fate())
                with suppress(EOFError):
                    self.start()
        reason = f"its worker died {TRIES} times ({', '.join(fates)}): out of memory, killed, or a crash"
        return Outcome(order=order, reason=reason, died=True)

    def _ask(self, order: Order) -> SeedPart | str:
        self.send((order.task, order.parcel))
        answer: SeedPart | str = self.receive()
        return answer


def serve() -> None:
    """What a worker process does: run what comes in on standard input until it closes."""
    orders, answers = served_streams()
    with suppress(EOFError, BrokenPipeError):
        while True:
            write(answers, run_seed(*pickle.load(orders)))
