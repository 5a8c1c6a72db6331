"""Small recordings in the formats of inD, rounD, exiD and highD, made by hand for tests."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

IND_META = {
    "recordingId": 0,
    "locationId": 4,
    "frameRate": 25,
    "speedLimit": 13.89,
    "latLocation": 49.0,
    "lonLocation": 8.4,
}
HIGHD_META = {
    "id": 1,
    "frameRate": 25,
    "locationId": 2,
    "speedLimit": -1.0,
    "upperLaneMarkings": "8.51;12.59;16.43",
    "lowerLaneMarkings": "21.00;25.00;29.00;33.00",
}


@dataclass(frozen=True, kw_only=True)
class Mover:
    """Someone in straight motion: centre (x, y) at frame ``first``, heading in rad, y upwards.

    In highD y is negative, for pictures begin at the top.
    """

    number: int
    x: float
    y: float
    heading: float = 0.0
    speed: float = 10.0
    kind: str = "car"
    first: int = 0
    frames: int = 101
    length: float = 4.5
    width: float = 1.8

    def place(self, frame: int, rate_hz: float) -> tuple[float, float]:
        """Centre at a frame."""
        driven = self.speed * (frame - self.first) / rate_hz
        return self.x + driven * math.cos(self.heading), self.y + driven * math.sin(self.heading)


def write_ind(
    folder: Path, movers: Sequence[Mover], *, number: int = 0, meta: Mapping[str, Any] = IND_META
) -> Path:
    """Write a recording of inD; the path of its tracks."""
    tracks, kinds = [], []
    for mover in movers:
        kinds.append({"trackId": mover.number, "class": mover.kind})
        for k in range(mover.first, mover.first + mover.frames):
            x, y = mover.place(k, float(meta["frameRate"]))
            row = {
                "recordingId": number,
                "trackId": mover.number,
                "frame": k,
                "trackLifetime": k - mover.first,
                "xCenter": round(x, 5),
                "yCenter": round(y, 5),
                "heading": round(math.degrees(mover.heading) % 360.0, 5),
                "width": mover.width,
                "length": mover.length,
                "xVelocity": round(mover.speed * math.cos(mover.heading), 5),
                "yVelocity": round(mover.speed * math.sin(mover.heading), 5),
                "latLaneCenterOffset": "0.1;-0.2",  # exiD writes several values into one column
            }
            tracks.append(row)
    return _write(folder, number, tracks, kinds, meta)


def write_highd(
    folder: Path, movers: Sequence[Mover], *, number: int = 1, meta: Mapping[str, Any] = HIGHD_META
) -> Path:
    """Write a recording of highD; the path of its tracks."""
    tracks, kinds = [], []
    for mover in movers:
        leftwards = math.cos(mover.heading) < 0.0
        kinds.append(
            {"id": mover.number, "class": mover.kind.title(), "drivingDirection": 1 if leftwards else 2}
        )
        for k in range(mover.first, mover.first + mover.frames):
            x, y = mover.place(k, float(meta["frameRate"]))
            row = {
                "frame": k,
                "id": mover.number,
                "x": round(x - mover.length / 2.0, 3),
                "y": round(-y - mover.width / 2.0, 3),
                "width": mover.length,
                "height": mover.width,
                "xVelocity": round(mover.speed * math.cos(mover.heading), 3),
                "yVelocity": round(-mover.speed * math.sin(mover.heading), 3),
            }
            tracks.append(row)
    return _write(folder, number, tracks, kinds, meta)


def _write(
    folder: Path,
    number: int,
    tracks: list[dict[str, Any]],
    kinds: list[dict[str, Any]],
    meta: Mapping[str, Any],
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in (("tracks", tracks), ("tracksMeta", kinds), ("recordingMeta", [dict(meta)])):
        with (folder / f"{number:02}_{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return folder / f"{number:02}_tracks.csv"
