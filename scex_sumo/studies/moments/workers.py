"""Worker processes for moments; those that die are replaced."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any, TypeAlias

from scex_sumo.base.errors import OutOfTimeError, UsageError, reason_of
from scex_sumo.extrapolation.processes.pool import WorkersDied
from scex_sumo.extrapolation.processes.workers import Workers
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.run import MomentTask, attempt

Done: TypeAlias = tuple[MomentTask, Any]
Work: TypeAlias = Callable[[Any, SeedScene], Any]
"""A function of a module: returns the result of a `MomentTask` and its seed scene with the road."""


class MomentWorkers:
    """Worker processes, one moment at a time each."""

    def __init__(self, count: int) -> None:
        if count < 1:
            raise UsageError(f"--workers: got {count}, needs at least 1")
        self._workers = Workers(count + 1)  # this process loads recordings and writes

    @property
    def deaths(self) -> list[str]:
        """One phrase for each worker that died and was replaced."""
        return self._workers.deaths

    def run(self, work: Work, tasks: Iterable[MomentTask]) -> Iterator[Done]:
        """Run tasks, a few at a time; yield them with their results, or `Failure`s, as they finish."""
        assert self._workers.pool is not None
        pool, opened = self._workers.pool, partial(_opened, work)
        for task, future in pool.run_each(opened, tasks, where=lambda t: f"at {t.ref.moment}"):
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
        """End the workers."""
        self._workers.__exit__()


def _opened(work: Work) -> AbstractContextManager[Callable[[MomentTask, object], Any]]:
    return nullcontext(lambda task, _: attempt(work, task))
