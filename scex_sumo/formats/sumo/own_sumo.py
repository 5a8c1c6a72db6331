"""The user's own SUMO, which simulates their configurations."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from scex_sumo.base.errors import SimulationError
from scex_sumo.base.sumo.programs import sumo_home

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
