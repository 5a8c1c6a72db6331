"""Who runs the seeds: processes of this machine. Each is one of libsumo's, and dies alone."""

from __future__ import annotations

import dataclasses
import signal
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from scex_sumo.interrupts import deaf_to_ctrl_c
from scex_sumo.ranking.seeds import SeedRef
from scex_sumo.ranking.work import Parcel, SeedPart, SeedTask, run_seed
from scex_sumo.scene import SeedScene

DIED = "its worker died twice (killed, out of memory, or a crash of SUMO)"


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
    """Worker processes of this machine.

    Every worker is a pool of its own, so that it is known which seed a dead one had; that is done again once.
    """

    def __init__(self, count: int) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="scex-rank-", ignore_cleanup_errors=True)
        self._pools: list[Any] = [None] * count

    def run(self, orders: Iterable[Order]) -> Iterator[Outcome]:
        """See `Crew`."""
        from concurrent.futures.process import BrokenProcessPool

        waiting, again = iter(orders), deque[Order]()
        tried: set[int] = set()
        running: dict[Future[Any], tuple[int, Order]] = {}
        idle = deque(range(len(self._pools)))
        while True:
            while idle and (order := again.popleft() if again else next(waiting, None)) is not None:
                worker = idle.popleft()
                running[self._pool(worker).submit(run_seed, order.task, order.parcel)] = worker, order
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                worker, order = running.pop(future)
                idle.append(worker)
                try:
                    answer = future.result()
                except BrokenProcessPool:
                    self._end(worker)
                    if id(order) in tried:
                        yield Outcome(order=order, reason=DIED, died=True)
                    else:
                        tried.add(id(order))
                        again.append(order)
                    continue
                yield outcome(order, answer)

    def close(self) -> None:
        """See `Crew`."""
        for worker in range(len(self._pools)):
            self._end(worker)
        self._folder.cleanup()

    def _pool(self, worker: int) -> Any:
        if self._pools[worker] is None:
            from joblib.externals.loky import ProcessPoolExecutor

            with deaf_to_ctrl_c():
                pool = ProcessPoolExecutor(
                    max_workers=1, timeout=None, initializer=_begin, initargs=(Path(self._folder.name),)
                )
                pool.submit(int)  # starts the process now, deaf as it is
            self._pools[worker] = pool
        return self._pools[worker]

    def _end(self, worker: int) -> None:
        pool, self._pools[worker] = self._pools[worker], None
        if pool is not None:
            pool.shutdown(wait=True, kill_workers=True)


def _begin(folder: Path) -> None:
    """Temporary files go where the ranking's own process removes them, also those of a worker killed."""
    tempfile.tempdir = str(folder)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
