"""``scex-sumo inspect FOLDER``: the recordings below a folder, how long they are and what is doubtful."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Any

from scex_sumo.base.errors import ScexError
from scex_sumo.commands.console import output_console
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import load_recording
from scex_sumo.reports.run_table import console_table

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
