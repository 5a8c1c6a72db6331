"""Ctrl-C belongs to the process that the user started."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Processes started meanwhile never see Ctrl-C: this one ends them, and only this one speaks of it."""
    if threading.current_thread() is not threading.main_thread():  # where Python lets nobody set signals
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # inherited, unlike a handler
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
