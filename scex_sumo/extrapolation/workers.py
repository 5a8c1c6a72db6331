"""Processes that share the batches of a run: this one, and helpers that start while it still reads.

Whoever is free takes the next batch, so that nobody waits for another, and what a batch gives depends on
nothing but its children. A helper that dies is started again once for the batch that it had.
"""

from __future__ import annotations

import importlib
import pickle
import queue
import sys
import tempfile
import threading
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from scex_sumo.errors import SimulationError, UsageError
from scex_sumo.extrapolation.helper_process import DIED, HelperProcess, served_streams, write

if TYPE_CHECKING:
    from scex_sumo.arrays import IntArray
    from scex_sumo.extrapolation.job import Job

OnStep: TypeAlias = Callable[[int], None]
Report: TypeAlias = tuple[Literal["ready", "tick", "done", "failed"], Any]


class Workers:
    """Processes that run batches of children; a context manager. Helpers start at once, unasked."""

    def __init__(self, processes: int) -> None:
        """Start all but one of the processes; this one is the other.

        Args:
            processes: how many there shall be.

        Raises:
            UsageError: fewer than one.
        """
        if processes < 1:
            raise UsageError(f"--workers: got {processes}, needs at least 1")
        self.processes = processes
        self.deaths: list[str] = []
        """One phrase for each helper that died and was started again."""
        self._folder = tempfile.TemporaryDirectory(prefix="scex-workers-") if processes > 1 else None
        self._helpers = [_Helper(self._folder.name) for _ in range(processes - 1)] if self._folder else []

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def prepare(self, modules: Sequence[str]) -> None:
        """Have helpers import what the first job will need while this process does so."""
        for helper in self._helpers:
            helper.serve(partial(helper.prepare, modules))

    def close(self) -> None:
        """End the helpers at once, whatever they are at; may be called again."""
        for helper in self._helpers:
            helper.kill()
        for helper in self._helpers:
            helper.bury()
        if self._folder is not None:
            self._folder.cleanup()

    def run(
        self, job: Job, batches: Sequence[IntArray], *, on_step: OnStep | None = None
    ) -> Iterator[IntArray]:
        """Run batches of children and keep their parts in the result folder.

        Args:
            job: the run.
            batches: numbers of the children of each batch.
            on_step: called with a number of children when they have made a step, in any process.

        Yields:
            The children of each batch when it is finished, in any order.

        Raises:
            SimulationError: a helper died twice over the same batch.
            Exception: whatever a batch raises, wherever it runs.
        """
        from scex_sumo.extrapolation.job import run_batches

        left, reports = deque(batches), queue.SimpleQueue[Report]()
        slots = sorted({int(slot) for batch in batches for slot in job.slots(batch)})
        busy = self._helpers[: max(len(batches) - 1, 0)]
        payload = _packed((job, slots)) if busy else b""
        for helper in busy:
            helper.serve(partial(self._serve, helper, payload, left, reports))
        unfinished = len(batches)

        def read() -> Iterator[IntArray]:
            nonlocal unfinished
            kind, content = reports.get()
            if kind == "tick" and on_step is not None:
                on_step(content)
            elif kind == "done":
                unfinished -= 1
                yield content
            elif kind == "failed":
                left.clear()
                raise content[0] from content[1]

        with closing(run_batches(job, _taken(left), slots=slots, on_step=on_step)) as own:
            for batch in own:
                unfinished -= 1
                yield batch
                while not reports.empty():
                    yield from read()
        while unfinished:
            yield from read()

    def _serve(
        self, helper: _Helper, payload: bytes, left: deque[IntArray], reports: queue.SimpleQueue[Report]
    ) -> None:
        """Hand batches to a helper as long as there are any, the first when it is ready for it."""
        try:
            going = self._twice(helper, "before its first children", partial(helper.hire, payload, reports))
            for batch in _taken(left) if going else ():
                where = f"over children {int(batch[0])} to {int(batch[-1])}"
                if not self._twice(helper, where, partial(helper.work, payload, batch, reports)):
                    return
        except BaseException as error:  # raised again where the batches are waited for
            reports.put(("failed", (error, None)))

    def _twice(self, helper: _Helper, where: str, order: Callable[[], bool]) -> bool:
        """What an order gives, from another process where the first one dies."""
        try:
            return order()
        except DIED:
            if helper.ended:
                raise
            self.deaths.append(f"a worker died {where} ({helper.fate()}) and was replaced")
        helper.start()
        try:
            return order()
        except DIED:
            raise SimulationError(
                f"a worker died twice {where} ({helper.fate()}); finished children are kept, "
                "the same command goes on"
            ) from None


def _taken(left: deque[IntArray]) -> Iterator[IntArray]:
    """Batches that nobody else has taken, as long as there are any."""
    with suppress(IndexError):
        while True:
            yield left.popleft()


class _Helper(HelperProcess):
    """One more process that runs batches, one thread of this one at a time giving it orders."""

    def __init__(self, folder: str) -> None:
        self._thread: threading.Thread | None = None
        super().__init__(__name__, folder)

    def start(self) -> None:
        """Start the process, which knows of no job."""
        self._job: bytes | None = None
        super().start()

    def serve(self, orders: Callable[[], None]) -> None:
        """Have a thread give it orders, when the one before it has none left."""
        before = self._thread

        def give() -> None:
            if before is not None:
                before.join()
            orders()

        self._thread = threading.Thread(target=give, name="scex-helper", daemon=True)
        self._thread.start()

    def prepare(self, modules: Sequence[str]) -> None:
        """Have it import modules that a job will need; nothing happens where it has died."""
        with suppress(*DIED):
            self.send(("import", modules))

    def hire(self, job: bytes, reports: queue.SimpleQueue[Report]) -> bool:
        """Wait until it is ready for a job; whether it is. Raises one of `DIED` where it dies."""
        # As the path is now, with the folder of the user's own models.
        self.send(("job", (sys.path, job)))
        self._job = job
        return self._answers(reports) == "ready"

    def work(self, job: bytes, batch: IntArray, reports: queue.SimpleQueue[Report]) -> bool:
        """Have it run a batch; whether it did. Raises one of `DIED` where it dies."""
        if self._job is not job and not self.hire(job, reports):
            return False
        self.send(("batch", batch))
        return self._answers(reports) == "done"

    def _answers(self, reports: queue.SimpleQueue[Report]) -> str:
        kind = "tick"
        while kind == "tick":
            report: Report = self.receive()
            reports.put(report)
            kind = report[0]
        return kind


class _Elsewhere(Exception):
    """The traceback of an error in a helper, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def serve() -> None:
    """What a helper does: run the batches that come in on standard input until it closes."""
    orders, reports = served_streams()
    from scex_sumo.extrapolation.job import run_batches
    from scex_sumo.world.sumo import load_sumo

    load_sumo()  # there is time before the first order
    order: tuple[str, Any] = ("", None)

    def batches() -> Iterator[IntArray]:
        nonlocal order
        write(reports, ("ready", None))
        while (order := pickle.load(orders))[0] == "batch":
            yield order[1]

    def tick(children: int) -> None:
        write(reports, ("tick", children))

    with suppress(EOFError, BrokenPipeError):
        order = pickle.load(orders)
        try:
            while True:
                if order[0] == "import":
                    for module in order[1]:
                        importlib.import_module(module)
                    order = pickle.load(orders)
                    continue
                sys.path[:], packed = order[1]
                job, slots = pickle.loads(packed)
                for children in run_batches(job, batches(), slots=slots, on_step=tick):
                    write(reports, ("done", children))
        except (EOFError, BrokenPipeError):
            raise
        except Exception as error:
            write(reports, ("failed", (_sendable(error), _Elsewhere(traceback.format_exc()))))


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling runs code of the error's own
        return SimulationError(f"a worker failed: {type(error).__name__}: {error}")
    return error


def _packed(content: Any) -> bytes:
    """Pickled; classes of the user's own script by value, since a helper does not run the script."""
    try:
        packed = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    except (pickle.PicklingError, AttributeError, TypeError):
        packed = b"__main__"
    if b"__main__" not in packed:
        return packed
    import cloudpickle

    by_value: bytes = cloudpickle.dumps(content)
    return by_value
