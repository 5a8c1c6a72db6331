"""Time limit of users' code: a line when it is slow, an error when it does not return.

Native code, such as a TorchScript module, cannot be interrupted: a process of the command line ends then.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from scex_sumo.base.errors import OutOfTimeError, last_words

QUIET_S = 2.0  # after which a line says that the run waits
RETURN_S = 5.0  # for Python code to end by the error that is raised in it
_TICK_S = 0.25


class _Interrupt(BaseException):
    """Raised in code that is out of its time; `BaseException`, as that code may catch its own errors."""


class _Call:
    def __init__(self, what: str, limit_s: float) -> None:
        self.what, self.limit_s = what, limit_s
        self.ticks = 0  # not a clock: a process that was stopped has not used its time
        self.words = f"{what} did not return within {limit_s:g} s; look for an endless loop in it"


_calls: dict[int, _Call] = {}  # by thread
_lock = threading.Lock()
_told: set[str] = set()
_watcher: list[threading.Thread] = []


@contextmanager
def time_limit(what: str, limit_s: float) -> Iterator[None]:
    """Print a line if the block takes more than 2 s; raise an `OutOfTimeError` if it takes too long.

    Args:
        what: names the code in messages.
    """
    call, thread = _Call(what, limit_s), threading.get_ident()
    if thread in _calls:  # of code within such code
        yield
        return
    try:
        with _lock:
            _calls[thread] = call
            if not (_watcher and _watcher[-1].is_alive()):  # none yet, or this process was forked
                _watcher[:] = [threading.Thread(target=_watch, name="scex-time-limit", daemon=True)]
                _watcher[-1].start()
        try:
            yield
        finally:
            with _lock:
                del _calls[thread]
    except _Interrupt:
        raise OutOfTimeError(call.words) from None


def _watch() -> None:
    while True:
        time.sleep(_TICK_S)
        with _lock:
            for thread, call in _calls.items():
                _look(thread, call)


def _look(thread: int, call: _Call) -> None:
    call.ticks += 1
    if call.ticks * _TICK_S == QUIET_S and call.what not in _told:
        _told.add(call.what)
        print(f"waiting up to {call.limit_s:g} s for {call.what}", file=sys.stderr, flush=True)
    over = call.ticks - round(call.limit_s / _TICK_S)
    if over == 0:
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(_Interrupt))
    elif over == round(RETURN_S / _TICK_S):
        _give_up(call.words)


def _give_up(words: str) -> None:
    if not last_words:
        print(f"{words}; it cannot be interrupted, end the process", file=sys.stderr)
        return
    try:
        last_words[-1](words)
        sys.stderr.flush()
    finally:
        os._exit(1)
