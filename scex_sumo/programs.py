"""SUMO's programs and files, as the eclipse-sumo wheel has them, whatever is on the user's PATH."""

from __future__ import annotations

import importlib.util
import os
import sys
from functools import cache
from pathlib import Path

from scex_sumo.errors import SimulationError


@cache
def sumo_home() -> Path:
    """Folder of SUMO, with ``bin``, ``data`` and ``tools``.

    The environment gets the variables that it gets from importing the wheel's package, which takes 10 ms.
    """
    found = importlib.util.find_spec("sumo")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("No module named 'sumo'", name="sumo")
    home = Path(found.origin).parent
    os.environ.setdefault("SUMO_HOME", str(home))
    if not os.environ.get("PROJ_LIB") and not os.environ.get("PROJ_DATA"):
        os.environ["PROJ_LIB"] = os.environ["PROJ_DATA"] = str(home / "data" / "proj")
    return home


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
