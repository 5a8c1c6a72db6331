"""Workers for moments: processes of this machine, or a Dask cluster, which replaces dead workers."""

from __future__ import annotations

import dataclasses
import hashlib
import logging
import socket
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from scex_sumo.base.errors import (
    MissingExtraError,
    OutOfTimeError,
    ScexError,
    UsageError,
    one_line,
    reason_of,
)
from scex_sumo.base.version import __version__
from scex_sumo.extrapolation.processes.pool import WorkersDied
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.run import MomentTask

if TYPE_CHECKING:
    from distributed import Client, Future

Done: TypeAlias = tuple[MomentTask, Any]
Work: TypeAlias = Callable[..., Any]
"""Runs a `MomentTask`, and maybe a road, and returns a result or a `Failure`."""

_CONNECT_S = 20
_ASK_S = 2.0  # how often the number of workers is looked up
_AHEAD = 2  # tasks for each thread of the cluster: one runs, one waits
_LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")
"""They print tracebacks when the scheduler goes away, which one line here says."""


class MomentWorkers(Protocol):
    """Workers on this machine or elsewhere."""

    def notes(self) -> list[str]:
        """Return notes for the user."""

    def run(self, tasks: Iterable[MomentTask], work: Work | None = None) -> Iterator[Done]:
        """Run tasks, a few at a time; yield them with their results as they finish.

        Args:
            work: a function of a module; None for that of all workers.
        """

    def close(self) -> None:
        """End the workers."""


def moment_workers(work: Work, workers: int | str) -> MomentWorkers:
    """Return so many processes of this machine, or the workers of the Dask scheduler at this address."""
    return LocalWorkers(workers, work) if isinstance(workers, int) else DaskWorkers(workers, work)


class LocalWorkers:
    """Worker processes of this machine, one moment at a time each."""

    def __init__(self, count: int, work: Work) -> None:
        if count < 1:
            raise UsageError(f"--workers: got {count}, needs at least 1")
        self._work = work
        self._workers = Workers(count + 1)  # this process loads recordings and writes

    def notes(self) -> list[str]:
        """See `MomentWorkers`."""
        return self._workers.deaths

    def run(self, tasks: Iterable[MomentTask], work: Work | None = None) -> Iterator[Done]:
        """See `MomentWorkers`."""
        assert self._workers.pool is not None
        for task, future in self._workers.pool.run_each(
            partial(_runner, work or self._work), tasks, where=lambda task: f"at {task.ref.moment}"
        ):
            try:
                yield task, future.result()
            except OutOfTimeError as error:
                if not task.may_be_late:
                    raise
                yield task, Failure.of(task.ref, reason_of(error))
            except WorkersDied as error:
                _, ends = error.args
                died = f"its worker died {len(ends)} times ({', '.join(ends)})"
                reason = f"{died}: out of memory, killed, or a crash"
                yield task, Failure.of(task.ref, reason, died=True)

    def close(self) -> None:
        """See `MomentWorkers`."""
        self._workers.__exit__()


def _runner(work: Work) -> AbstractContextManager[Callable[[MomentTask, object], Any]]:
    return nullcontext(lambda task, _: work(task))


class DaskWorkers:
    """The workers behind a Dask scheduler.

    Each road is a task of its own, which the scheduler repeats if the workers that hold it die.
    """

    def __init__(self, address: str, work: Work) -> None:
        """Connect to a scheduler."""
        try:
            from distributed import Client, Security
        except ImportError:
            raise MissingExtraError(
                "--workers: distributed is not installed; pip install '.[cluster]' in the clone"
            ) from None
        _check_reachable(address)
        for name in _LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        try:
            secured = Security().get_connection_args("client").get("ssl_context") is not None
            if address.startswith("tls://") and not secured:
                raise UsageError(
                    f"--workers {address}: no certificate for TLS; name ca-file, cert and key in Dask's "
                    "configuration, see docs/cluster.md"
                )
            self._client: Client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # a timeout is an OSError
            raise _no_scheduler(address, error) from None
        try:
            self._client.wait_for_workers(1, timeout=_CONNECT_S)
        except TimeoutError:
            self.close()
            raise UsageError(
                f"--workers {address}: no worker has joined it; start some with "
                f"'dask worker {address} --nthreads 1'"
            ) from None
        several = sum(count > 1 for count in self._client.nthreads().values())
        self._notes = [
            f"{several} Dask workers have several threads, and one SUMO each, which they wait for; "
            "start workers with --nthreads 1"
        ][: several > 0]
        self._work = work
        self._roads: dict[bytes, Future] = {}
        self._threads, self._asked_at = 1, -_ASK_S

    def notes(self) -> list[str]:
        """See `MomentWorkers`."""
        return self._notes

    def _room(self) -> int:
        now = time.monotonic()
        if now - self._asked_at > _ASK_S:
            with _answering():
                self._threads = sum(self._client.nthreads().values())
            self._asked_at = now
        return _AHEAD * max(self._threads, 1)

    def run(self, tasks: Iterable[MomentTask], work: Work | None = None) -> Iterator[Done]:
        """See `MomentWorkers`."""
        from distributed import as_completed

        waiting = iter(tasks)
        running: dict[str, MomentTask] = {}
        finished = as_completed(loop=self._client.loop)
        while True:
            room = self._room()
            while len(running) < room and (task := next(waiting, None)) is not None:
                with _answering():
                    future = self._submit(task, work or self._work)
                running[future.key] = task
                finished.add(future)
            if not running:
                return
            with _answering():
                future = next(finished)
            task = running.pop(future.key)
            yield task, _result(task, future)
            future.release()

    def _submit(self, task: MomentTask, work: Work) -> Future:
        road = task.road
        assert road is not None
        if road not in self._roads:
            key = f"scex-road-{hashlib.sha256(road).hexdigest()[:32]}"
            self._roads[road] = self._client.submit(publish_road, road, key=key)
        bare = dataclasses.replace(task, road=None)
        return self._client.submit(work, bare, self._roads[road], pure=False)

    def close(self) -> None:
        """See `MomentWorkers`; the cluster itself goes on."""
        self._client.close(timeout=1)


def _check_reachable(address: str) -> None:
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdigit():
        raise UsageError(f"--workers {address}: needs the address of a Dask scheduler, e.g. tcp://host:8786")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECT_S).close()
    except (OSError, OverflowError) as error:
        raise _no_scheduler(address, error) from None


def _no_scheduler(address: str, error: Exception) -> UsageError:
    return UsageError(
        f"--workers {address}: no Dask scheduler answers: {one_line(error)}; start one with "
        "'dask scheduler' and give the address that it prints"
    )


def publish_road(road: bytes) -> bytes:
    """Return a road: a task of Dask that brings it to the workers."""
    return road


@contextmanager
def _answering() -> Iterator[None]:
    try:
        yield
    except (OSError, CancelledError):
        raise ScexError(
            "the Dask scheduler went away; finished seed scenes are kept; run the same command again to go on"
        ) from None


def _result(task: MomentTask, future: Future) -> Any:
    from distributed import KilledWorker

    try:
        with _answering():
            return future.result()
    except ScexError:
        raise
    except KilledWorker as error:
        return Failure.of(task.ref, f"its workers died: {one_line(error)}", died=True)
    except Exception as error:  # not from the moment, whose errors come back as words
        raise ScexError(
            f"a Dask worker cannot run seeds: {reason_of(error)}; all need scex-sumo {__version__}"
        ) from error
