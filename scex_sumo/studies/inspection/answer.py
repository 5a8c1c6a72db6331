"""Answer of ``inspect --json``; docs/json.md lists its keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scex_sumo.converters.datasets.moment import Moment, busiest
from scex_sumo.evaluation.recordings import LoadedRecording
from scex_sumo.scene import SeedScene


def inspect_answer(
    loaded: LoadedRecording, moments: list[Moment], scene: SeedScene | None, page: Path | None
) -> dict[str, Any]:
    """Return the answer of ``inspect --json``; ``scene`` is that of ``--time`` or ``--case``."""
    return {
        "recording": loaded.recording.name,
        "page": page,
        "seconds": loaded.seconds,
        "vehicles": loaded.vehicles,
        "findings": loaded.findings,
        "notes": loaded.notes,
        "checks": [vars(check) for check in loaded.checks],
        "moments": [_moment(moment) for moment in moments],
        "busiest": _moment(busiest(moments)) if moments else None,
        "scene": None if scene is None else _scene(scene),
    }


def _moment(moment: Moment) -> dict[str, Any]:
    there = {"vehicles": moment.vehicles, "complete": moment.complete}
    return {"time_s": moment.time_s, "case": moment.case or None, **there}


def _scene(scene: SeedScene) -> dict[str, Any]:
    now = {"x": scene.now.x, "y": scene.now.y, "speed": scene.now.speed, "length": scene.length}
    ids, kinds = scene.track_ids.tolist(), scene.types
    columns = {"track_id": ids, "type": kinds, **{name: values.tolist() for name, values in now.items()}}
    each = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return {"name": scene.name, "time_s": scene.time_s, "vehicles": each}
