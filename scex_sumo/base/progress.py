"""Progress of long functions: a callback, or a bar on a terminal or in a notebook."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

Progress: TypeAlias = Callable[[int, int], None]

_WIDTH = 30  # characters
_EVERY_S = 0.1


@contextmanager
def progress_of(wanted: Progress | bool | None, label: str) -> Iterator[Progress | None]:
    """Yield the function of (done, total) that shows progress.

    Args:
        wanted: such a function; True for a bar on standard error, if it is a terminal or a notebook's; None
            or False for nothing.
    """
    if wanted is not True:
        yield wanted or None
        return
    stream, begun, last = sys.stderr, time.monotonic(), [0.0]
    if not (stream.isatty() or type(stream).__module__.startswith("ipykernel")):
        yield None
        return

    def tick(done: int, total: int) -> None:
        now = time.monotonic()
        if now - last[0] < _EVERY_S and done < total:
            return
        last[0], share = now, done / max(total, 1)
        left = f"{(now - begun) * (1 / share - 1):.0f} s left" if share else ""
        bar = ("█" * round(_WIDTH * share)).ljust(_WIDTH)
        stream.write(f"\r{label}: {share:4.0%} |{bar}| {now - begun:.0f} s, {left:<12}")
        stream.flush()

    try:
        yield tick
    finally:
        if last[0]:
            stream.write("\n")
