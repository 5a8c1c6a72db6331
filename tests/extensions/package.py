"""Package of a stranger: one module with an entry point, written into a temporary folder and used by name."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests import command


def install(folder: Path, *, group: str, name: str, target: str, code: str) -> None:
    """Write ``stranger.py`` and the metadata by which an installed package registers it.

    Args:
        folder: stands for site-packages; `scex` puts it on the path.
        group: entry-point group, e.g. ``scex_sumo.maps``.
        name: the name in the registry.
        target: what the entry point names, e.g. ``stranger:write`` or ``stranger``.
        code: the module.
    """
    (folder / "stranger.py").write_text(code)
    info = folder / "stranger-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {target}\n")


def scex(folder: Path, *arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line where the stranger's package is installed."""
    return command.scex(*arguments, cwd=cwd, path=folder)
