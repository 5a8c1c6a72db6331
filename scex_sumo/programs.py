"""SUMO's programs and files, as the eclipse-sumo wheel has them, whatever is on the user's PATH."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from scex_sumo.errors import SimulationError


def sumo_home() -> Path:
    """Folder of SUMO, with ``bin``, ``data`` and ``tools``."""
    import sumo

    return Path(sumo.SUMO_HOME)


def program(name: str) -> str:
    """Path of one of SUMO's programs: ``sumo``, ``sumo-gui``, ``netconvert``, ...

    Raises:
        SimulationError: the wheel does not have it.
    """
    path = sumo_home() / "bin" / (f"{name}.exe" if sys.platform == "win32" else name)
    if not path.is_file():
        raise SimulationError(f"{path}: SUMO's program {name} is missing; reinstall eclipse-sumo")
    return str(path)


def environment() -> dict[str, str]:
    """Environment variables that SUMO's programs are started with."""
    return {**os.environ, "SUMO_HOME": str(sumo_home())}
