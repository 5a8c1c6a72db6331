"""SUMO in the eclipse-sumo wheel: its programs and files."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any

from scex_sumo.base.errors import SimulationError

# Limits of a program, and what they grow by for each byte of the file that it reads.
MEMORY_BYTES, MEMORY_PER_BYTE = 3 * 2**29, 150
TIME_S, TIME_PER_BYTE_S = 60.0, 2e-5
WAIT_S = 0.2


def sumo_home() -> Path:
    """Return SUMO's folder, with ``bin``, ``data`` and ``tools``."""
    import sumo

    return Path(sumo.SUMO_HOME)


def program(name: str) -> str:
    """Return the path of a program of SUMO, e.g. ``netconvert``; `SimulationError` if it is missing."""
    path = sumo_home() / "bin" / (f"{name}.exe" if sys.platform == "win32" else name)
    if not path.is_file():
        raise SimulationError(f"{path}: SUMO's program {name} is missing; reinstall eclipse-sumo")
    return str(path)


def environment() -> dict[str, str]:
    """Return the environment variables for SUMO's programs."""
    return {**os.environ, "SUMO_HOME": str(sumo_home())}


def _limit_memory(process: subprocess.Popen[Any], file_bytes: int) -> float:
    """Limit the memory of a program by the size of the file that it reads; return the limit in GiB."""
    limit = MEMORY_BYTES + MEMORY_PER_BYTE * file_bytes
    if sys.platform == "linux":
        import resource

        with suppress(ProcessLookupError):
            resource.prlimit(process.pid, resource.RLIMIT_AS, (limit, limit))
    return limit / 2**30


def run_program(
    name: str,
    *options: str,
    folder: Path,
    file_bytes: int,
    limit_s: float | None = None,
    on_wait: Callable[[], None] = lambda: None,
) -> tuple[str, ...]:
    """Run a program of SUMO in a folder, with a limit of memory.

    Args:
        file_bytes: size of the file that it reads; the limits grow with it.
        limit_s: of time, in place of that.
        on_wait: called every `WAIT_S` until it has ended; an exception stops it.

    Returns:
        What it complains about: errors as ``Error: ...``, a crash or a limit as ``Error: NAME ...``.
    """
    limit_s = TIME_S + TIME_PER_BYTE_S * file_bytes if limit_s is None else limit_s
    nowhere, command = subprocess.DEVNULL, [program(name), *options]
    with subprocess.Popen(
        command, stdout=nowhere, stderr=subprocess.PIPE, cwd=folder, env=environment()
    ) as process:
        limit_gib, stop_s, said = _limit_memory(process, file_bytes), monotonic() + limit_s, None
        try:
            while said is None:
                with suppress(subprocess.TimeoutExpired):
                    said = process.communicate(timeout=min(WAIT_S, limit_s))[1]
                if said is None and monotonic() > stop_s:
                    process.kill()
                    return (f"Error: {name} was stopped after {limit_s:.0f} s",)
                on_wait()
        except BaseException:
            process.kill()
            raise
    lines = [line.strip() for line in said.decode(errors="replace").splitlines() if line.strip()]
    status = process.returncode
    if status and any("bad_alloc" in line for line in lines):
        lines = [f"Error: {name} was stopped at {limit_gib:.1f} GiB of memory"]
    elif status < 0:
        lines.append(f"Error: {name} crashes ({signal.Signals(-status).name})")
    elif status and not any(line.startswith("Error") for line in lines):
        lines.append(f"Error: {name} ended with status {status}")
    return tuple(lines)


def checked_path(path: Path | str) -> str:
    """Return a path as a value of SUMO's options, which SUMO splits at commas."""
    if "," in str(path):
        raise SimulationError(
            f"{path}: SUMO splits paths at commas; rename the folder or file, or set TMPDIR to another folder"
        )
    return str(path)
