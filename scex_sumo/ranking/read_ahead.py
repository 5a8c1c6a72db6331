"""Reading ahead: recordings are loaded while seeds of the one before still run."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterator
from typing import TypeVar

T = TypeVar("T")

_END = object()
_LOOK_S = 0.1  # how often a waiting thread looks whether it is still wanted


def read_ahead(items: Iterator[T], size: int) -> Generator[T, None, None]:
    """The same items in the same order, up to ``size`` of them made ahead in a thread.

    An error of the items is raised where it would have come. Closing the result ends the thread after the
    item that it is at.
    """
    buffer: queue.Queue[object] = queue.Queue(maxsize=size)
    unwanted = threading.Event()

    def put(item: object) -> None:
        while not unwanted.is_set():
            try:
                buffer.put(item, timeout=_LOOK_S)
                return
            except queue.Full:
                continue

    def work() -> None:
        try:
            for item in items:
                put((item,))
                if unwanted.is_set():
                    return
            put(_END)
        except BaseException as error:
            put(error)

    threading.Thread(target=work, name="read ahead", daemon=True).start()
    try:
        while True:
            got = buffer.get()
            if got is _END:
                return
            if isinstance(got, BaseException):
                raise got
            assert isinstance(got, tuple)
            yield got[0]
    finally:
        unwanted.set()
