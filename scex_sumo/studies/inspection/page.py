"""Inspection page of a recording: moments, repairs, vehicles on the map."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.base.files import write_output
from scex_sumo.base.version import __version__
from scex_sumo.converters.datasets.moment import STAMP_MS, Moment, busiest, recorded_throughout
from scex_sumo.converters.tracks.rows import STANDING_MPS
from scex_sumo.drivers.listing import known_models
from scex_sumo.evaluation.recordings import LoadedRecording
from scex_sumo.page.document import Document
from scex_sumo.page.html import Html, element, joined
from scex_sumo.page.packing import UNITS, quantized
from scex_sumo.page.report.scene import lane_lines, road_paths

SCRIPTS = ("state.js", "pairs.js", "map.js", "inspect.js")
KINDS = ("moves, recorded from 1 s before to 3 s after", "moves, not recorded throughout", "stands")
_MAX_MOMENTS = 400
_AWAY = 10**8  # place of a missing vehicle
_SIZE_M = 0.01
_COLORS = ("drawn", "likely", "soft")  # of page.css, as in inspect.js


def write_inspection(path: Path, loaded: LoadedRecording, moments: Sequence[Moment], command: str) -> Path:
    """Write the page of a recording and return its path.

    Args:
        moments: at most 400 and the busiest are shown, evenly chosen.
        command: that runs a moment, without its time.

    Raises:
        TrackError: there is no moment.
    """
    if not moments:
        raise TrackError(f"{loaded.recording.name}: no moment with a vehicle; give another recording")
    numbers = np.linspace(0, len(moments) - 1, _MAX_MOMENTS).round().astype(int)
    numbers = np.append(numbers, moments.index(busiest(list(moments))))
    kept = [moments[k] for k in np.unique(numbers)]
    page = Document(loaded.recording.name, *SCRIPTS)
    page.arrays = _arrays(loaded, kept)
    page.info = {
        "moments": [
            (f"{m.time_s:g}", shlex.quote(m.case) if m.case else "", m.vehicles, m.complete) for m in kept
        ],
        "first": kept.index(busiest(kept)),
        "types": list(dict.fromkeys(loaded.table.vehicles.types)),
        "box": _box(page.arrays["poses"]),
        "road": road_paths(lane_lines(loaded.road)),
        "command": command,
        "stem": loaded.recording.name,
    }
    write_output(path, page.filled("inspect.html", **_parts(loaded, len(moments), len(kept))))
    return path


def _arrays(loaded: LoadedRecording, moments: Sequence[Moment]) -> dict[str, IntArray]:
    """Return (V, M, ...) arrays of vehicles by moment, by id: sizes in cm, poses in `UNITS`, times in 0.1 s.

    The id of a missing vehicle is -1.
    """
    table, rows = loaded.table, loaded.table.vehicles
    begin, end = rows.pieces
    kinds = np.where(rows.speed <= STANDING_MPS, 2, np.where(recorded_throughout(table), 0, 1))
    types = {kind: k for k, kind in enumerate(dict.fromkeys(rows.types))}
    columns = {
        "ids": rows.track_id,
        "kinds": kinds,
        "types": np.array([types[kind] for kind in rows.types], np.int64)[rows.track],
        "before": quantized(rows.timestamp_ms - rows.timestamp_ms[begin][rows.piece], 100.0),
        "after": quantized(rows.timestamp_ms[end][rows.piece] - rows.timestamp_ms, 100.0),
    }
    sizes = quantized(np.stack([rows.length, rows.width], axis=1), _SIZE_M)
    poses = quantized(np.stack([rows.x, rows.y, rows.psi_rad, rows.speed], axis=1), np.array(UNITS))
    here = [_rows_of(loaded, moment) for moment in moments]
    shape = max(map(len, here)), len(moments)
    arrays = {name: np.full(shape, -1) for name in columns}
    arrays |= {"sizes": np.zeros((*shape, 2), np.int64), "poses": np.full((*shape, 4), _AWAY)}
    for m, chosen in enumerate(here):
        for name, values in (columns | {"sizes": sizes, "poses": poses}).items():
            arrays[name][: len(chosen), m] = values[chosen]
    return arrays


def _rows_of(loaded: LoadedRecording, moment: Moment) -> IntArray:
    rows = loaded.table.vehicles
    then = np.abs(rows.timestamp_ms - 1000.0 * moment.time_s) < STAMP_MS
    chosen = np.flatnonzero(then & (rows.case == loaded.table.cases.index(moment.case)))
    return chosen[np.argsort(rows.track_id[chosen], kind="stable")]


def _box(poses: IntArray) -> list[float]:
    places = poses[poses[:, :, 0] < _AWAY][:, :2] * UNITS[0]
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    return [float(edge) for edge in (left, right, low, high)]


def _parts(loaded: LoadedRecording, moments: int, shown: int) -> dict[str, str]:
    rows = loaded.table.vehicles
    seconds = (float(rows.timestamp_ms.max()) - float(rows.timestamp_ms.min())) / 1000
    about = f"{rows.tracks} vehicles in {seconds:.1f} s, {moments} moments"
    findings = [element("li", finding) for finding in (*loaded.findings, *loaded.table.notes)]
    models = [element("option", model.name, value=model.name) for model in known_models()]
    return {
        "name": loaded.recording.name,
        "about": about + (f", {shown} of them shown" if shown < moments else ""),
        "legend": joined(*(_entry(number, words) for number, words in enumerate(KINDS))),
        "bars": "Bars: vehicles of each moment; coloured: moving and recorded throughout.",
        "models": joined(*models),
        "findings": element("ul", *findings) if findings else element("p.soft", "No repair was needed."),
        "foot": f"scex-sumo {__version__} · {loaded.recording.map_path}",
    }


def _entry(number: int, words: str) -> Html:
    fill = f"var(--{_COLORS[number]})"
    return element("div", element("svg", element("rect", width="14", height="8", rx="2", fill=fill)), words)
