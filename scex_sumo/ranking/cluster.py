"""Workers of a Dask cluster; Dask schedules, and gives a dead worker's seeds to others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from scex_sumo.errors import MissingExtraError, UsageError
from scex_sumo.ranking.crew import Order, Outcome, outcome
from scex_sumo.ranking.work import Parcel, run_seed

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_S = 20
_AHEAD = 2
"""Orders for each thread of the cluster: one that runs, one that waits for it."""


def run_packed(task: Any, parcel: Parcel) -> Any:
    """Run a seed on a worker of a cluster."""
    return run_seed(task, parcel)


class Cluster:
    """The workers behind a Dask scheduler.

    Roads are tasks of their own, which only hand on what the scheduler has of them: where the workers that
    hold one die, the scheduler makes it again.
    """

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            MissingExtraError: distributed is not installed.
            UsageError: nobody answers at the address.
        """
        try:
            from distributed import Client
        except ImportError:
            raise MissingExtraError(
                "--cluster: distributed is not installed; pip install 'scex-sumo[cluster]'"
            ) from None
        try:
            self._client: Client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            raise UsageError(
                f"--cluster {address}: no Dask scheduler answers: {' '.join(str(error).split())}; "
                "start one with 'dask scheduler' and give its address, e.g. tcp://host:8786"
            ) from None
        self._roads: dict[str, Future] = {}

    @property
    def threads(self) -> dict[str, int]:
        """Threads by worker."""
        return {str(name): int(n) for name, n in self._client.nthreads().items()}

    def run(self, orders: Iterable[Order]) -> Iterator[Outcome]:
        """See `Crew`."""
        from distributed import as_completed

        waiting = iter(orders)
        running: dict[str, Order] = {}
        finished = as_completed()
        finished_with_last = False
        while True:
            room = max(_AHEAD * sum(self.threads.values()), _AHEAD) - len(running)
            while room > 0 and not finished_with_last:
                order = next(waiting, None)
                if order is None:
                    finished_with_last = True
                    break
                future = self._submit(order)
                running[future.key] = order
                finished.add(future)
                room -= 1
            if not running:
                return
            future = next(finished)
            yield _collect(running.pop(future.key), future)
            future.release()

    def _submit(self, order: Order) -> Future:
        parcel = order.parcel
        if parcel.key not in self._roads:
            key = f"scex-road-{parcel.key}"
            self._roads[parcel.key] = self._client.submit(Parcel, key=key, packed=parcel.packed)
        return self._client.submit(run_packed, order.task, self._roads[parcel.key], pure=False)

    def close(self) -> None:
        """See `Crew`; the cluster goes on without us."""
        self._client.close(timeout=1)


def _collect(order: Order, future: Future) -> Outcome:
    from distributed import KilledWorker

    try:
        return outcome(order, future.result())
    except KilledWorker as error:
        return Outcome(order=order, reason=f"its workers died: {error}", died=True)
