"""Service of a worker: the tasks that come in on its standard input, one after the other."""

from __future__ import annotations

import pickle
import sys
import traceback
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

from scex_sumo.errors import SimulationError
from scex_sumo.extrapolation.workers.process import served_streams, write


class _Elsewhere(Exception):
    """The traceback of an error in a worker, as text."""

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def serve() -> None:
    """What a worker process does: the tasks that come in on standard input until it closes."""
    orders, reports = served_streams()
    from scex_sumo.world.session import load_sumo

    load_sumo()  # there is time before the first task

    def report(kind: str, content: Any) -> None:
        write(reports, (kind, content))

    with suppress(EOFError, BrokenPipeError), ExitStack() as opened:
        while True:
            kind, content = pickle.load(orders)
            try:
                if kind == "open":
                    opened.close()
                    sys.path[:], packed = content
                    do = opened.enter_context(pickle.loads(packed)())
                    report("done", None)
                else:
                    report("done", do(content, partial(report, "step")))
            except (EOFError, BrokenPipeError):
                raise
            except Exception as error:
                opened.close()
                report("failed", (_sendable(error), _Elsewhere(traceback.format_exc())))


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # pickling runs code of the error's own
        return SimulationError(f"a worker failed: {type(error).__name__}: {error}")
    return error
