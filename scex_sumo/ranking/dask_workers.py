"""Workers of a Dask cluster; Dask schedules, and gives a dead worker's seeds to others."""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import TYPE_CHECKING

from scex_sumo.errors import MissingExtraError, ScexError, UsageError
from scex_sumo.ranking.seeds import one_line, reason_of
from scex_sumo.ranking.task import Parcel, run_seed
from scex_sumo.ranking.workers import Order, Outcome, outcome
from scex_sumo.version import __version__

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_S = 20
_ASK_S = 2.0  # how often the number of workers is looked up
_AHEAD = 2
"""Orders for each thread of the cluster: one that runs, one that waits for it."""


def _knock(address: str) -> None:
    """Ask whether anybody listens, which Dask would go on trying for a while, and not in one line.

    Raises:
        UsageError: nobody does, or it is no address.
    """
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdigit():
        raise UsageError(f"--cluster {address}: needs the address of a Dask scheduler, e.g. tcp://host:8786")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S).close()
    except (OSError, OverflowError) as error:
        raise _no_scheduler(address, error) from None


def _no_scheduler(address: str, error: Exception) -> UsageError:
    return UsageError(
        f"--cluster {address}: no Dask scheduler answers: {one_line(str(error))}; start one with "
        "'dask scheduler' and give the address that it prints"
    )


def hand_on(parcel: Parcel) -> Parcel:
    """The task that brings a road to the workers."""
    return parcel


class Cluster:
    """The workers behind a Dask scheduler.

    Roads are tasks of their own, which only hand on what the scheduler has of them: where the workers that
    hold one die, the scheduler makes it again.
    """

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            MissingExtraError: distributed is not installed.
            UsageError: nobody answers at the address, or no worker joins.
        """
        try:
            from distributed import Client
        except ImportError:
            raise MissingExtraError(
                "--cluster: distributed is not installed; pip install 'scex-sumo[cluster]'"
            ) from None
        _knock(address)
        # Its tracebacks; what is wrong is said here in one line.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
        try:
            self._client: Client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            raise _no_scheduler(address, error) from None
        try:
            self._client.wait_for_workers(1, timeout=_CONNECT_S)
        except TimeoutError:
            self.close()
            raise UsageError(
                f"--cluster {address}: no worker has joined it; start some with "
                f"'dask worker {address} --nthreads 1'"
            ) from None
        self._roads: dict[str, Future] = {}
        self._threads, self._asked = 1, -_ASK_S

    @property
    def notes(self) -> list[str]:
        """What the user should know of the cluster."""
        several = sum(count > 1 for count in self._client.nthreads().values())
        if not several:
            return []
        return [
            f"{several} Dask workers have several threads, and one SUMO each, which they wait for; "
            "start workers with --nthreads 1"
        ]

    def _room(self) -> int:
        """How many orders the cluster shall have; workers come and go, so it is asked now and then."""
        now = time.monotonic()
        if now - self._asked > _ASK_S:
            with _answering():
                self._threads = sum(self._client.nthreads().values())
            self._asked = now
        return _AHEAD * max(self._threads, 1)

    def run(self, orders: Iterable[Order]) -> Iterator[Outcome]:
        """See `Crew`."""
        from distributed import as_completed

        waiting, last = iter(orders), False
        running: dict[str, Order] = {}
        finished = as_completed(loop=self._client.loop)
        while True:
            room = self._room() - len(running)
            while room > 0 and not last:
                if (order := next(waiting, None)) is None:
                    last = True
                    break
                with _answering():
                    future = self._submit(order)
                running[future.key] = order
                finished.add(future)
                room -= 1
            if not running:
                return
            with _answering():
                future = next(finished)
            yield _collected(running.pop(future.key), future)
            future.release()

    def _submit(self, order: Order) -> Future:
        parcel = order.parcel
        if parcel.key not in self._roads:
            key = f"scex-road-{parcel.key}"
            self._roads[parcel.key] = self._client.submit(hand_on, parcel, key=key)
        return self._client.submit(run_seed, order.task, self._roads[parcel.key], pure=False)

    def close(self) -> None:
        """See `Crew`; the cluster goes on without us."""
        self._client.close(timeout=1)


@contextmanager
def _answering() -> Iterator[None]:
    """Turn what Dask says of a scheduler that is gone into our words."""
    try:
        yield
    except (OSError, CancelledError):
        raise ScexError(
            "the Dask scheduler went away; finished seeds are kept, the same command goes on"
        ) from None


def _collected(order: Order, future: Future) -> Outcome:
    """The outcome of an order.

    Raises:
        ScexError: it is the cluster that failed.
    """
    from distributed import KilledWorker

    try:
        with _answering():
            return outcome(order, future.result())
    except ScexError:
        raise
    except KilledWorker as error:
        return Outcome(order=order, reason=f"its workers died: {one_line(str(error))}", died=True)
    except Exception as error:  # not from the seed, whose errors come back as words
        raise ScexError(
            f"a Dask worker cannot run seeds: {reason_of(error)}; all need scex-sumo {__version__}"
        ) from error
