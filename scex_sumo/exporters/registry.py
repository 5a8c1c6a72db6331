"""Exporters by name: each writes children of a run in one format.

One of your own is a function of a `Request` that returns the files it wrote, named by its import path
(``--to package.module:function``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, TypeAlias

from scex_sumo.errors import UsageError
from scex_sumo.exporters.request import Request
from scex_sumo.importing import import_object

Exporter: TypeAlias = Callable[[Request], list[Path]]

EXPORTERS: Final[Mapping[str, str]] = {
    "interaction": "scex_sumo.exporters.tracks:write_interaction",
    "fcd": "scex_sumo.exporters.tracks:write_fcd_files",
    "openscenario": "scex_sumo.exporters.openscenario:write_openscenario",
    "sumo": "scex_sumo.exporters.sumo_folder:write_sumo",
    "mp4": "scex_sumo.exporters.video:write_mp4",
    "gif": "scex_sumo.exporters.video:write_gif",
    "commonroad": "scex_sumo.exporters.commonroad:write_commonroad",
}
"""Import path by name: a format's libraries are loaded when somebody asks for it."""


def exporter(name: str) -> Exporter:
    """The exporter of a name or import path.

    Raises:
        UsageError: there is none.
    """
    if name not in EXPORTERS and ":" not in name:
        raise UsageError(
            f"--to {name}: unknown format; known: {', '.join(EXPORTERS)}; or package.module:function"
        )
    found: Exporter = import_object(EXPORTERS.get(name, name))
    return found
