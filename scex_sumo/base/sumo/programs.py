"""SUMO in the eclipse-sumo wheel: its programs and files."""

from __future__ import annotations

import os
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
