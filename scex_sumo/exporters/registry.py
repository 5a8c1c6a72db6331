"""Registry of exporters: functions that write the children of a `Request`, and return the files.

Packages add entry points in ``scex_sumo.exporters``; ``--to`` also takes ``package.module:function``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeAlias

from scex_sumo.base.registry import Registry
from scex_sumo.exporters.request import Request

Exporter: TypeAlias = Callable[[Request], list[Path]]

EXPORTERS: Final = Registry(
    group="scex_sumo.exporters",
    kind="export format",
    builtin={
        "interaction": "scex_sumo.exporters.tracks:write_interaction",
        "interpret": "scex_sumo.exporters.tracks:write_interpret",
        "fcd": "scex_sumo.exporters.tracks:write_fcd_files",
        "openscenario": "scex_sumo.exporters.openscenario:write_openscenario",
        "sumo": "scex_sumo.exporters.sumo_folder:write_sumo",
        "ssm": "scex_sumo.exporters.conflicts:write_ssm",
        "collisions": "scex_sumo.exporters.conflicts:write_collisions",
        "mp4": "scex_sumo.exporters.video:write_mp4",
        "gif": "scex_sumo.exporters.video:write_gif",
        "commonroad": "scex_sumo.exporters.commonroad:write_commonroad",
        "scenarionet": "scex_sumo.exporters.scenarionet:write_scenarionet",
    },
)
