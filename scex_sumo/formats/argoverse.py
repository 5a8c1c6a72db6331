"""Argoverse 2: motion-forecasting scenarios and logs of the sensor dataset, with their vector maps.

A scenario is ``scenario_ID.parquet`` beside ``log_map_archive_ID.json``; a log is ``annotations.feather`` or
``annotations_with_ego.feather`` and ``city_SE3_egovehicle.feather`` beside ``map/log_map_archive_*.json``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.registries import Dataset, MapFormat, Recording, with_notes
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.damage import MAX_ITEMS, checked, refusing_damage
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road
from scex_sumo.formats.recognition import AV2_BOXES, AV2_MAP, AV2_POSES, is_argoverse, is_argoverse_map
from scex_sumo.formats.samples.boxes import box_table, yaw_of
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road

EGO = "EGO_VEHICLE"
EGO_SIZE_M, EGO_CENTRE_M = (4.87, 1.85), 1.42
"""Ford Fusion; the pose is that of the rear axle, and the centre lies so far ahead of it."""
_KINDS = {
    **dict.fromkeys(("vehicle", "REGULAR_VEHICLE", EGO), "car"),
    **dict.fromkeys(("bus", "BUS", "SCHOOL_BUS", "ARTICULATED_BUS"), "bus"),
    **dict.fromkeys(("LARGE_VEHICLE", "BOX_TRUCK", "TRUCK", "TRUCK_CAB"), "truck"),
    **dict.fromkeys(("motorcyclist", "MOTORCYCLE"), "motorcycle"),
    **dict.fromkeys(("cyclist", "BICYCLIST", "WHEELED_RIDER"), "bicycle"),
    **dict.fromkeys(
        ("pedestrian", "PEDESTRIAN", "OFFICIAL_SIGNALER", "WHEELCHAIR", "STROLLER"), "pedestrian"
    ),
}
"""Road users; the others are things, or one of two boxes: motorcycle and rider, bicycle and rider."""
_LANE_KINDS = {"VEHICLE": "vehicle", "BIKE": "bicycle", "BUS": "bus"}
_MOTION = ("position_x", "position_y", "velocity_x", "velocity_y", "heading")
_COLUMNS = ("track_id", "object_type", "timestep", *_MOTION)
_WORDS = {"track_id", "object_type", "track_uuid", "category"}  # columns of text, of scenarios and logs


def _read_road(path: Path, **_: Any) -> Road:
    """Read ``log_map_archive_*.json``; the speed limits are those of the United States."""
    with refusing_damage(MapError, path, "map of Argoverse 2"):
        content = json.loads(path.read_bytes())
        segments, crossings = ([*content[key].values()] for key in ("lane_segments", "pedestrian_crossings"))
        drawn = DrawnMap(path=path, lanes=[_lane(segment) for segment in segments])
        drawn.crosswalks = [[*_points(walk["edge1"]), *_points(walk["edge2"])[::-1]] for walk in crossings]
        return drawn_road(drawn, name=_name(path), country="us")


def _lane(segment: Mapping[str, Any]) -> DrawnLane:
    kind = segment["lane_type"]
    sides = {side: str(segment[f"{side}_lane_mark_type"]) for side in ("left", "right")}
    beside = {side: segment[f"{side}_neighbor_id"] for side in sides}
    return DrawnLane(
        name=segment["id"],
        left=_points(segment["left_lane_boundary"]),
        right=_points(segment["right_lane_boundary"]),
        kind=_LANE_KINDS.get(kind, "other"),
        subtype={"BIKE": "bicycle_lane", "BUS": "bus_lane"}.get(kind, "road"),
        inside=bool(segment["is_intersection"]),
        closed=tuple(side for side, mark in sides.items() if "SOLID" in mark),
        successors=segment["successors"],
        predecessors=segment["predecessors"] or None,  # older maps leave them empty
        left_neighbours=[beside["left"]],
        right_neighbours=[beside["right"]],
    )


def _points(points: Sequence[Mapping[str, float]]) -> list[list[float]]:
    return [[point["x"], point["y"], point.get("z", 0.0)] for point in points]


def _read(path: Path) -> TrackTable:
    with refusing_damage(TrackError, path, "recording of Argoverse 2"):
        return _scenario(path) if path.suffix == ".parquet" else _log(path)


def _scenario(path: Path) -> TrackTable:
    import pyarrow.parquet as pq

    if (rows := pq.read_metadata(path.absolute()).num_rows) * len(_COLUMNS) > MAX_ITEMS:
        raise TrackError(f"{path}: {rows} rows; name one scenario")
    names, kinds, time, *numbers = _columns(pq.read_table(path.absolute()), _COLUMNS)
    values = np.column_stack([100.0 * time, *numbers, np.full((len(time), 2), np.nan)])
    return box_table(path, names, _kinds(names, kinds), values, ego="AV")


def _log(path: Path) -> TrackTable:
    from pyarrow import feather

    if not path.exists():
        raise TrackError(f"{path}: no such file; the test logs are published without boxes: give another log")
    table, poses = feather.read_table(path), feather.read_table(path.with_name(AV2_POSES))
    turns = ("qw", "qx", "qy", "qz")
    wanted = ("track_uuid", "category", "timestamp_ns", "tx_m", "ty_m", "length_m", "width_m", *turns)
    names, kinds, time, x, y, length, width, *turn = _columns(table, wanted)
    pose_time, ego_x, ego_y, *ego_turn = _columns(poses, ("timestamp_ns", "tx_m", "ty_m", *turns))
    if not len(pose_time):
        raise TrackError(f"{path.with_name(AV2_POSES)}: no pose in it; fetch the file again")
    order = np.argsort(pose_time)
    pose_time, ego_x, ego_y = (column[order] for column in (pose_time, ego_x, ego_y))
    ego_yaw = np.unwrap(yaw_of(*(column[order] for column in ego_turn)))
    boxes = np.stack([time, x, y, length, width, yaw_of(*turn)])
    if EGO not in kinds:  # the log as published: the ego has poses only
        frames = np.unique(time)
        names, kinds = [*names, *([EGO] * len(frames))], [*kinds, *([EGO] * len(frames))]
        own = np.stack(np.broadcast_arrays(frames, EGO_CENTRE_M, 0.0, *EGO_SIZE_M, 0.0))
        boxes = np.hstack([boxes, own])
    time, x, y, length, width, yaw = boxes
    ex, ey, ea = (np.interp(time, pose_time, column) for column in (ego_x, ego_y, ego_yaw))
    c, s = np.cos(ea), np.sin(ea)
    unknown = np.full(len(time), np.nan)
    values = np.column_stack(
        [time / 1e6, ex + c * x - s * y, ey + s * x + c * y, unknown, unknown, wrap(yaw + ea), length, width]
    )
    ego = next((name for name, kind in zip(names, kinds, strict=True) if kind == EGO), "")
    return box_table(path, names, _kinds(names, kinds), values, ego=ego)


def _columns(table: Any, names: Sequence[str]) -> list[Any]:
    checked(table)
    columns = {name: table[name].to_numpy(zero_copy_only=False) for name in names}
    return [[*map(str, x)] if name in _WORDS else x.astype(np.float64) for name, x in columns.items()]


def _kinds(names: Sequence[str], kinds: Sequence[str]) -> dict[str, str]:
    return {name: _KINDS.get(kind, kind.lower()) for name, kind in zip(names, kinds, strict=True)}


def _tracks(path: Path) -> Path | None:
    scenario = path.with_name(path.name.replace("log_map_archive_", "scenario_")).with_suffix(".parquet")
    return scenario if scenario.is_file() else _boxes(path.parent.parent)


def _boxes(log: Path) -> Path | None:
    """Return the boxes of a log, which need not exist: those of the test logs are not published."""
    there = next((file for name in AV2_BOXES if (file := log / name).is_file()), None)
    return there or (log / AV2_BOXES[1] if (log / AV2_POSES).is_file() else None)


def _map_of(path: Path) -> Path:
    if path.suffix == ".parquet":
        return path.with_name(path.name.replace("scenario_", "log_map_archive_")).with_suffix(".json")
    return next(iter(sorted(path.parent.glob(f"map/{AV2_MAP}"))), path.parent / "map" / AV2_MAP)


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    known: set[Path] = set()
    for path in files:
        boxes = path if path.suffix == ".parquet" else _boxes(path.parent)
        if boxes is None or boxes in known:
            continue
        known.add(boxes)
        map_path = _map_of(path)
        name = _name(map_path)
        yield Recording(name=name, site=name, dataset="argoverse", map_path=map_path, track_paths=(boxes,))


def _name(path: Path) -> str:
    """Name of a scenario or log: the first eight characters of its id."""
    return f"av2_{path.stem.removeprefix('log_map_archive_')[:8]}"


ARGOVERSE_MAP = MapFormat(
    is_mine=is_argoverse_map,
    read=_read_road,
    tracks=_tracks,
    name=_name,
    asks_for="--tracks scenario_*.parquet",
)
ARGOVERSE = Dataset(
    is_mine=is_argoverse,
    read=with_notes(_read),
    recordings=_recordings,
    name=lambda path, files: _name(path),
    within=within_map,
)
