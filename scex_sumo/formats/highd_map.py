"""Map of a highD recording: a straight motorway from its lane markings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.naming import map_name, plain_or_packed, unpacked_name
from scex_sumo.converters.registries import MapFormat
from scex_sumo.formats.levelx import TRACKS, has_lane_markings, read_meta
from scex_sumo.road import Lane, Road

META = "_recordingMeta.csv"
FILMED_M = 420.0
"""Length of road in a highD picture, as published; x runs from 0 to there."""
BEYOND_M = 150.0
"""Straight extension at both ends: 180 km/h drives so far in 3 s."""
NO_LIMIT_MPS = 130.0 / 3.6
"""If ``speedLimit`` is -1: the advised speed on German motorways without a limit."""
_POINT_M = 10.0


def _name(path: Path) -> str:
    return f"highd_{map_name(path).removesuffix(Path(META).stem)}"


def _tracks(path: Path) -> Path:
    tracks = path.with_name(unpacked_name(path).replace(META, TRACKS))
    return plain_or_packed(tracks) or tracks


def _read_road(path: Path, **_: object) -> Road:
    """Build lanes, with highD's own ``laneId``, from ``upperLaneMarkings`` and ``lowerLaneMarkings``."""
    try:
        meta = read_meta(path)
    except TrackError as error:
        raise MapError(str(error)) from None
    if not has_lane_markings(meta):
        raise MapError(f"{path}: no lane markings in it, so no road; give a Lanelet2 map (.osm)")
    upper, lower = (_markings(path, meta, f"{side}LaneMarkings") for side in ("upper", "lower"))
    try:
        limit = float(meta.get("speedLimit") or -1.0)
    except ValueError:
        raise MapError(f"{path}: speedLimit is {meta['speedLimit']!r}; a number expected, in m/s") from None
    speed = limit if limit > 0.0 else NO_LIMIT_MPS
    lanes = _carriageway(upper, first_id=2, leftwards=True, speed_mps=speed)
    lanes |= _carriageway(lower, first_id=len(upper) + 2, leftwards=False, speed_mps=speed)
    return Road(
        name=_name(path),
        lanes=lanes,
        notes=(
            f"straight lanes by highD's markings, {BEYOND_M:g} m longer than filmed at both ends"
            + ("" if limit > 0.0 else "; no speed limit: 130 km/h"),
        ),
    )


def _markings(path: Path, meta: dict[str, str], name: str) -> FloatArray:
    text = meta.get(name, "")
    try:
        values = np.array([float(part) for part in text.split(";") if part.strip()])
    except ValueError:
        values = np.array([math.nan])
    if len(values) < 2 or not np.isfinite(values).all() or not (np.diff(values) > 1.0).all():
        raise MapError(f"{path}: {name} is {text!r}; rising numbers more than 1 m apart expected")
    return values


def _carriageway(
    markings: FloatArray, *, first_id: int, leftwards: bool, speed_mps: float
) -> dict[int, Lane]:
    x = np.linspace(-BEYOND_M, FILMED_M + BEYOND_M, round((FILMED_M + 2 * BEYOND_M) / _POINT_M) + 1)
    x = x[::-1] if leftwards else x
    count = len(markings) - 1
    lanes = {}
    for k in range(count):
        top, bottom = -markings[k], -markings[k + 1]
        # For a vehicle that drives to the left, left is downwards in the picture.
        left, right = (bottom, top) if leftwards else (top, bottom)
        above, below = (first_id + k - 1 if k else None), (first_id + k + 1 if k + 1 < count else None)
        on_left, on_right = (below, above) if leftwards else (above, below)
        lanes[first_id + k] = Lane(
            lane_id=first_id + k,
            centreline=np.stack((x, np.full(len(x), (top + bottom) / 2.0)), axis=1),
            left_bound=np.stack((x, np.full(len(x), left)), axis=1),
            right_bound=np.stack((x, np.full(len(x), right)), axis=1),
            width_m=float(top - bottom),
            speed_limit_mps=speed_mps,
            subtype="highway",
            location="nonurban",
            left=on_left,
            right=on_right,
            adjacent_left=on_left,
            adjacent_right=on_right,
        )
    return lanes


HIGHD = MapFormat(
    is_mine=lambda path: unpacked_name(path).endswith(META), read=_read_road, tracks=_tracks, name=_name
)
