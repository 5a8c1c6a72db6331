"""Number of processes of a run, as a user gives it, and cores for them."""

from __future__ import annotations

import os
from pathlib import Path
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


def idle_cores() -> int:
    """Return the number of cores on which nothing else runs at this moment, at least 1; all where unknown."""
    try:
        running = int(Path("/proc/loadavg").read_text().split()[3].partition("/")[0])
    except (OSError, ValueError, IndexError):
        return cores()
    return max(cores() - (running - 1), 1)
