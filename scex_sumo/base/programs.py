"""Programs and files of SUMO in the eclipse-sumo wheel."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from scex_sumo.base.errors import SimulationError


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


def checked_path(path: Path | str) -> str:
    """Return a path as a value of SUMO's options, which SUMO splits at commas."""
    if "," in str(path):
        raise SimulationError(
            f"{path}: SUMO splits paths at commas; rename the folder or file, or set TMPDIR to another folder"
        )
    return str(path)


OLDEST_SUMO = (1, 20)


def user_sumo() -> Path | None:
    """Return the user's own ``sumo``, in the folder that ``SUMO_HOME`` names; None for the wheel's.

    Raises:
        SimulationError: it is older than 1.20, or does not run.
    """
    home = os.environ.get("SUMO_HOME")
    own = Path(home or "") / "bin" / ("sumo.exe" if sys.platform == "win32" else "sumo")
    if not home or Path(home).resolve() == sumo_home().resolve() or not own.is_file():
        return None
    remedy = "set SUMO_HOME to another one, or unset it"
    try:
        done = subprocess.run([own, "--version"], capture_output=True, text=True, check=False, timeout=20)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SimulationError(f"{own}: does not run ({error}); {remedy}") from None
    version = re.search(r"\b(\d+)\.(\d+)", done.stdout)
    if version is None or tuple(map(int, version.groups())) < OLDEST_SUMO:
        got = f"version {version[0]}" if version else "of no known version"
        raise SimulationError(f"{own}: {got}; needs {'.'.join(map(str, OLDEST_SUMO))} or newer; {remedy}")
    return own
