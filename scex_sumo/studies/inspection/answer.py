"""Answers of ``inspect --json``, see docs/json.md, and the recordings below a folder as a table."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Any

from scex_sumo.base.errors import ScexError
from scex_sumo.commands.console import output_console
from scex_sumo.converters.datasets.moment import Moment, busiest
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording
from scex_sumo.reports.console_table import console_table
from scex_sumo.scene import SeedScene


def inspect_answer(loaded: LoadedRecording, moments: list[Moment], scene: SeedScene | None) -> dict[str, Any]:
    """Return the answer of ``inspect --json``; ``scene`` is that of ``--time`` or ``--case``."""
    return {
        "recording": loaded.recording.name,
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
    counts = {"vehicles": moment.vehicles, "complete": moment.complete}
    return {"time_s": moment.time_s, "case": moment.case or None, **counts}


def _scene(scene: SeedScene) -> dict[str, Any]:
    now = {"x": scene.now.x, "y": scene.now.y, "speed": scene.now.speed, "length": scene.length}
    ids, kinds = scene.track_ids.tolist(), scene.types
    columns = {"track_id": ids, "type": kinds, **{name: values.tolist() for name, values in now.items()}}
    vehicles = [dict(zip(columns, vehicle, strict=True)) for vehicle in zip(*columns.values(), strict=True)]
    return {"name": scene.name, "time_s": scene.time_s, "vehicles": vehicles}


_PLACES = [("recording", "names", ""), ("site", "names", ""), ("vehicles", "text", "")]
_HEADS = [*_PLACES, ("seconds", ".1f", ""), ("repaired", "text", ""), ("doubts", "words", "")]


def inspect_folder(recordings: Sequence[Recording]) -> dict[str, Any]:
    """Print a table of recordings, and how to inspect the first; return the answer of ``--json``."""
    rows = [_row(recording) for recording in recordings]
    keys = ("recording", "site", "vehicles", "seconds", "repairs", "doubts")
    table = [[row[key] for key in keys[:-1]] + ["; ".join(row["doubts"])] for row in rows]
    output_console(width=110).print(console_table(f"{len(rows)} recordings", _HEADS, table))
    first = recordings[0]
    words = ["scex-sumo", "inspect", str(first.map_path), "--tracks", str(first.place)]
    print(f"one of them: {shlex.join(words)}")
    return {"recordings": rows}


def _row(recording: Recording) -> dict[str, Any]:
    """Return what a recording holds; one that cannot be read has the reason among its doubts."""
    row: dict[str, Any] = {"recording": recording.name, "site": recording.site}
    try:
        loaded = load_recording(recording, force=True)
    except ScexError as error:
        return row | {"vehicles": None, "seconds": None, "repairs": None, "doubts": [f"not read: {error}"]}
    return row | {
        "vehicles": loaded.vehicles,
        "seconds": loaded.seconds,
        "repairs": len(loaded.findings),
        "doubts": [check.problem for check in loaded.checks if check.verdict in ("warning", "error")],
    }
