"""Small recordings made by hand, for tests of the track reader."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

MOTION = ["track_id", "frame_id", "timestamp_ms", "agent_type", "x", "y", "vx", "vy"]
COLUMNS = [*MOTION, "psi_rad", "length", "width"]
Row = dict[str, Any]


def straight(
    track: int | str = 1,
    frames: Iterable[int] = range(41),
    *,
    speed: float = 10.0,
    start: float = 0.0,
    y: float = 0.0,
    kind: str = "car",
    step_ms: float = 100.0,
    **changes: Any,
) -> list[Row]:
    """A vehicle along +x that is at ``start`` in frame 0 and keeps its speed; one row per frame."""
    motion = {"vx": speed, "vy": 0.0} | changes
    return moving(lambda t: (start + speed * t, y), track, frames, kind=kind, step_ms=step_ms, **motion)


def moving(
    place: Callable[[float], tuple[float, float]],
    track: int | str = 1,
    frames: Iterable[int] = range(41),
    *,
    kind: str = "car",
    step_ms: float = 100.0,
    **changes: Any,
) -> list[Row]:
    """A vehicle at ``place(seconds)``; velocity and heading are those of the motion unless given."""
    rows = []
    for frame in frames:
        t = frame * step_ms / 1000.0
        x, y = place(t)
        (x1, y1), (x0, y0) = place(t + 5e-4), place(t - 5e-4)
        vx, vy = (x1 - x0) / 1e-3, (y1 - y0) / 1e-3
        row = {
            "track_id": track,
            "frame_id": frame,
            "timestamp_ms": round(frame * step_ms),
            "agent_type": kind,
            "x": x,
            "y": y,
            "vx": vx,
            "vy": vy,
            "psi_rad": float(np.arctan2(vy, vx)),
            "length": 4.5,
            "width": 1.8,
        }
        rows.append(row | changes)
    return rows


def write_rows(path: Path, rows: list[Row], columns: Iterable[str] = COLUMNS) -> Path:
    """Write rows as CSV; a value that a row lacks is left empty."""
    columns = list(columns)
    lines = [",".join(columns)]
    lines += [",".join(str(row.get(name, "")) for name in columns) for row in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def in_case(case: str, rows: list[Row]) -> list[Row]:
    """The same rows as part of a case."""
    return [row | {"case_id": case} for row in rows]


CASE_COLUMNS = ["case_id", *COLUMNS]
