"""Ticker of a watch: moments that are assessed in other processes while the simulation goes on."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.errors import ScexError, TrackError, UsageError, reason_of, warn_notes
from scex_sumo.extrapolation.processes.pool import Pool, WorkersDied
from scex_sumo.live.moment import Focus, Moment, road_of
from scex_sumo.live.risk import Question, Risk, assess

_EARLY_S: Final = 1e-6  # SUMO's times are rounded
_WHERE = "in the futures"


class Ticker:
    """Assesses the moment every so often; at most one for each process at a time, others are skipped.

    Attributes:
        risk: of the last finished moment; None before.
        skipped: moments that were due while all processes worked.
    """

    def __init__(
        self,
        every_s: float,
        callback: Callable[[Risk], object] | None,
        *,
        question: Question,
        focus: Focus,
        net: Path,
        wait: bool,
        workers: int,
    ) -> None:
        """Start the processes; with ``wait`` the simulation waits where a moment would be skipped."""
        if not every_s > 0:
            raise UsageError(f"--every: got {every_s}, needs seconds above 0")
        if workers < 1:
            raise UsageError(f"--workers: got {workers}, needs at least 1")
        self.risk: Risk | None = None
        self.skipped = 0
        self._every_s, self._callback, self._wait = every_s, callback, wait
        self._question, self._focus = question, focus
        self._due_s: float | None = None
        self._pools = deque(Pool(1) for _ in range(workers))
        self._running: deque[tuple[Pool, Future[Risk]]] = deque()
        self._warned: set[str] = set()
        self._starts = [pool.submit(partial(road_of, net), where=_WHERE) for pool in self._pools]
        self._end = weakref.finalize(self, _close, tuple(self._pools))

    def close(self) -> None:
        """Kill the processes; moments that are not finished are lost."""
        self._end()
        self._running.clear()
        self._pools.clear()

    def get_ready(self) -> None:
        """Wait until the processes have started and read the net."""
        for start in self._starts:
            start.exception()

    def step(self, time_s: float, moment: Callable[[Focus], Moment]) -> None:
        """Take up finished moments, and the present one if it is due; call it after each step."""
        self.take_up()
        if self._due_s is None or time_s < self._due_s - 2 * self._every_s:  # or a state was loaded
            self._due_s = time_s
        if not self._end.alive or time_s < self._due_s - _EARLY_S:
            return
        while self._due_s < time_s + _EARLY_S:
            self._due_s += self._every_s
        if not self._pools and not self._wait:
            self.skipped += 1
            return
        if not self._pools:
            self.finish(left=len(self._running) - 1)
        pool = self._pools.popleft()
        try:
            future = pool.submit(partial(assess, moment(self._focus), self._question), where=_WHERE)
        except BaseException:
            self._pools.append(pool)
            raise
        self._running.append((pool, future))
        if self._wait and not self._pools and len(self._running) == 1:
            self.finish()

    def finish(self, *, left: int = 0) -> None:
        """Wait for moments until only so many are left."""
        while len(self._running) > left:
            self._running[0][1].exception()  # waits
            self.take_up()

    def take_up(self) -> None:
        """Take up finished moments in their order, and call the callback with each."""
        while self._running and self._running[0][1].done():
            pool, future = self._running.popleft()
            self._pools.append(pool)
            try:
                self.risk = future.result()
            except TrackError:  # nobody is on the road
                continue
            except WorkersDied as died:
                self._warn_once(
                    f"a process died twice {died.args[0]} ({died.args[1][-1]}); the moment is left out"
                )
                continue
            except ScexError as error:
                self._warn_once(f"a moment is left out: {reason_of(error)}")
                continue
            if self._callback is not None:
                try:
                    self._callback(self.risk)
                except Exception as error:  # the simulation goes on
                    self._warn_once(f"the callback failed: {reason_of(error)}")

    def _warn_once(self, note: str) -> None:
        if note not in self._warned:
            self._warned.add(note)
            warn_notes([note])


def _close(pools: Any) -> None:
    for pool in pools:
        pool.close()
