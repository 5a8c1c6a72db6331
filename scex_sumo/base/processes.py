"""Number of processes of a run, as a user gives it."""

from __future__ import annotations

import os
from typing import Final

from scex_sumo.base.errors import UsageError

AUTO: Final = "auto"


def read_workers(text: str) -> int | str:
    """Read a number of processes, or ``auto``."""
    if text != AUTO and not text.strip().lstrip("-").isdigit():
        raise UsageError(f"--workers {text}: needs a number or {AUTO}")
    return text if text == AUTO else int(text)


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
