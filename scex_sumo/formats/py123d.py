"""Logs of 123D (py123d): one Arrow format for nuPlan, Waymo, Argoverse 2, nuScenes, KITTI-360 and others.

A log is a folder with ``sync.arrow``. Its map is ``map.arrow`` beside it, or
``maps/DATASET/DATASET_LOCATION.arrow`` in a folder above it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.base.importing import extra_for
from scex_sumo.converters.registries import Dataset, MapFormat, own_maps, with_notes
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.damage import checked, refusing_damage
from scex_sumo.formats.lane_maps.lane_map import DrawnLane, DrawnMap, drawn_road
from scex_sumo.formats.recognition import PY123D_LOG, is_py123d, is_py123d_map
from scex_sumo.formats.samples.boxes import box_table, yaw_of
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.formats.spat import lane_programme
from scex_sumo.lanelet2sumo.plan.elements import NetLayout, Programme
from scex_sumo.road import Road

MAP = "map.arrow"
EGO = "ego_vehicle"
AROUND_M = 150.0  # a map of a city is cut so far around the vehicles of a log
LANE, GROUP, CROSSWALK, STOP, EDGE, LINE = 0, 1, 3, 7, 8, 9  # layers
_KINDS = {1: "vehicle", 2: "vehicle", 3: "bicycle", 4: "bus"}
_SIGNS = {2: "stop", 3: "yield"}
_SOLID = {6, 7, 10, 11, 14}
_LETTERS = {0: "G", 1: "y", 2: "r", 3: "O"}
# Types of road users by number; a dash is none.
_LABELS = {
    "Default": "car car - bicycle pedestrian",
    "AV2Sensor": "- bus - bicycle - truck bus - - - truck - - motorcycle - pedestrian pedestrian - car bus "
    "- - - - truck truck truck pedestrian - bicycle",
    "KITTI360": "bicycle - bus car car - motorcycle pedestrian - bicycle - - - - truck - - truck",
    "NuPlan": "car bicycle pedestrian",
    "Nureasoning": "car bicycle pedestrian - - - - truck bus motorcycle bicycle pedestrian",
    "NuScenes": "car truck bus bus truck car car truck bicycle motorcycle" + 7 * " pedestrian",
    "Pandaset": "- - bicycle bus car - - car truck motorcycle bicycle truck bicycle car pedestrian "
    "pedestrian pedestrian car - - - truck - - truck",
    "WODPerception": "- car pedestrian - bicycle",
    "WODMotion": "- car pedestrian bicycle",
    "PhysicalAIAV": "car pedestrian bus truck car - bicycle pedestrian truck",
    "Griffin": "pedestrian car truck bus motorcycle bicycle",
}


def _msgpack() -> Any:
    with extra_for("logs of 123D need msgpack", "formats"):
        import msgpack
    return msgpack


def _table(path: Path) -> Any:
    import pyarrow as pa

    with pa.OSFile(str(path), "rb") as source:
        return checked(pa.ipc.open_file(source).read_all())


def _meta(path: Path) -> dict[str, Any]:
    import pyarrow as pa

    with pa.OSFile(str(path), "rb") as source:
        schema = pa.ipc.open_file(source).schema
    packed = (schema.metadata or {}).get(b"metadata")
    if packed is None:
        raise ValueError(f"{path.name} has no metadata")
    return dict(_msgpack().unpackb(packed, raw=False, strict_map_key=False))


def _array(item: dict[Any, Any]) -> Any:
    if b"__ndarray__" not in item:
        return item
    if not re.fullmatch(r"[<>|=]?[biuf]\d{1,2}", word := str(item[b"dtype"])):  # NumPy evaluates others
        raise ValueError(f"array of {word:.20}")
    return np.frombuffer(item[b"data"], np.dtype(word)).reshape(item[b"shape"])


def _map_of(path: Path) -> Path:
    """Map file of a log, or the path itself if it is a map."""
    if path.name not in (PY123D_LOG, MAP) and path.with_name(PY123D_LOG).is_file():
        raise ValueError(f"one file of a log; give {PY123D_LOG} beside it")
    if path.name != PY123D_LOG:
        return path
    if (beside := path.with_name(MAP)).is_file():
        return beside
    of_map = _meta(path).get("map_metadata") or {}
    names = [str(of_map.get(key) or "") for key in ("dataset", "location")]
    if not all(name and Path(name).name == name for name in names):
        raise ValueError("the log has no map")
    place = Path("maps", names[0], f"{names[0]}_{names[1]}.arrow")
    file = next((above / place for above in path.absolute().parents if (above / place).is_file()), None)
    if file is None:
        raise ValueError(f"its map {place} is in no folder above it")
    return file


def _read_road(path: Path, **_: Any) -> Road:
    with refusing_damage(MapError, path, "map of 123D"):
        return drawn_road(_drawn(path), name=_name(path), country="us")


def _drawn(path: Path) -> DrawnMap:
    map_path = _map_of(path)
    table = _table(map_path)
    columns = [table[name].to_pylist() for name in ("object_id", "map_layer", "features", "wkb")]
    shapes = shapely.from_wkb(columns[3], on_invalid="ignore")
    keep = np.ones(len(shapes), bool)
    if path.name == PY123D_LOG and not _meta(map_path).get("map_is_per_log"):
        places = _boxes(path)[2][:, 1:3]
        area = shapely.box(*places.min(axis=0) - AROUND_M, *places.max(axis=0) + AROUND_M)
        keep = shapely.intersects(area, shapes)
    layers: dict[int, list[tuple[int, dict[str, Any], Any]]] = {}
    for number, layer, packed, shape, near in zip(*columns[:3], shapes, keep, strict=True):
        if near and layer in (LANE, GROUP, CROSSWALK, STOP, EDGE, LINE):
            feature = _msgpack().unpackb(packed, object_hook=_array, raw=False, strict_map_key=False)
            layers.setdefault(layer, []).append((number, feature, shape))
    inside = {number for number, group, _ in layers.get(GROUP, ()) if group["intersection_id"] is not None}
    drawn = DrawnMap(path=path, lanes=[_lane(i, lane, inside) for i, lane, _ in layers.get(LANE, ())])
    drawn.crosswalks = [walk["outline"] for _, walk, _ in layers.get(CROSSWALK, ())]
    for _, stop, _ in layers.get(STOP, ()):
        if sign := _SIGNS.get(stop["stop_zone_type"]):
            drawn.stops |= dict.fromkeys(stop["lane_ids"], sign)
    drawn.lines = [("road_border", "", shapely.get_coordinates(line)) for _, _, line in layers.get(EDGE, ())]
    for _, marking, line in layers.get(LINE, ()):
        if (kind := marking["road_line_type"]) > 0:
            points = shapely.get_coordinates(line)
            drawn.lines.append(("line_thin", "solid" if kind in _SOLID else "dashed", points))
    if path.name == PY123D_LOG:
        drawn.lit = dict.fromkeys(_lights(path))
    return drawn


def _lane(number: int, lane: Mapping[str, Any], inside: set[int]) -> DrawnLane:
    kind, freeway = lane["lane_type"], lane["lane_type"] == 1
    return DrawnLane(
        name=number,
        centre=lane["centerline"],
        left=lane["left_boundary"],
        right=lane["right_boundary"],
        kind=_KINDS.get(kind, "vehicle"),
        subtype="highway" if freeway else "road",
        location="" if freeway else "urban",
        limit_mps=lane["speed_limit_mps"],
        inside=lane["lane_group_id"] in inside,
        successors=lane["successor_ids"],
        predecessors=lane["predecessor_ids"],
        left_neighbours=[lane["left_lane_id"]],
        right_neighbours=[lane["right_lane_id"]],
    )


def _modality(path: Path, kind: str) -> Path | None:
    return next(iter(sorted(path.parent.glob(f"{kind}*.arrow"))), None)


def _column(table: Any, name: str) -> Any:
    return table[next((full for full in table.column_names if full.endswith(f".{name}")), name)]


def _boxes(path: Path) -> tuple[list[str], dict[str, str], FloatArray]:
    """Return track and type of each box, and (N, 8) values as `box_table` reads them."""
    names: list[str] = []
    kinds: dict[str, str] = {}
    parts: list[FloatArray] = []
    file = _modality(path, "box_detections_se3")
    stamps = np.zeros(0)
    if file is not None:
        table, label_class = _table(file), str(_meta(file)["box_detection_label_class"])
        word = label_class.rsplit(".", 1)[-1].removesuffix("BoxDetectionLabel")
        if word not in _LABELS:
            raise ValueError(f"unknown box types {word}")
        words = _LABELS[word].split()
        columns = ("timestamp_us", "track_token", "label", "bounding_box_se3", "velocity_3d")
        stamps, *lists = (_column(table, name).to_pylist() for name in columns)
        for stamp, tokens, labels, boxes, velocities in zip(stamps, *lists, strict=True):
            for token, label, box, velocity in zip(tokens, labels, boxes, velocities, strict=True):
                names.append(str(token))
                is_user = label < len(words) and words[label] != "-"
                kinds[names[-1]] = words[label] if is_user else f"type {label}"
                x, y, _, *turn, length, width, _ = box
                vx, vy, _ = velocity or (np.nan, np.nan, np.nan)
                parts.append(np.array([stamp / 1e3, x, y, vx, vy, float(yaw_of(*turn)), length, width]))
    ego = _ego(path, np.array(stamps, np.float64) / 1e3)
    names += [EGO] * len(ego)
    kinds |= {EGO: "car"} if len(ego) else {}
    return names, kinds, np.concatenate([np.reshape(parts, (-1, 8)), ego])


def _ego(path: Path, stamps_ms: FloatArray) -> FloatArray:
    """Return (T, 8) states of the recording vehicle's centre, at the stamps of the boxes if there are any."""
    file = _modality(path, "ego_state_se3")
    if file is None:
        return np.empty((0, 8))
    table, meta = _table(file), _meta(file)
    time = _column(table, "timestamp_us").to_numpy() / 1e3
    pose = np.array(_column(table, "imu_se3").to_pylist(), np.float64).reshape(-1, 7)
    motion = [(dynamics or [np.nan] * 9)[:2] for dynamics in _column(table, "dynamic_state_se3").to_pylist()]
    yaw = np.unwrap(yaw_of(*pose[:, 3:7].T))
    c, s = np.cos(yaw), np.sin(yaw)
    (ahead, aside), (u, v) = meta["center_to_imu_se3"][:2], np.reshape(motion, (-1, 2)).T
    x, y = pose[:, 0] + c * ahead - s * aside, pose[:, 1] + s * ahead + c * aside
    columns = np.stack([x, y, c * u - s * v, s * u + c * v, yaw])
    if len(stamps_ms):
        stamps_ms = np.unique(stamps_ms[(stamps_ms >= time.min()) & (stamps_ms <= time.max())])
        columns = np.stack([np.interp(stamps_ms, time, column) for column in columns])
        time = stamps_ms
    sizes = np.broadcast_to([meta["length"], meta["width"]], (len(time), 2))
    return np.column_stack([time, *columns, sizes])


def _lights(path: Path) -> dict[int, list[tuple[float, str]]]:
    """Return time in s from the first frame and letter of each lane's light."""
    file = _modality(path, "traffic_light_detections")
    if file is None:
        return {}
    table = _table(file)
    stamps, lanes, states = (_column(table, n).to_pylist() for n in ("timestamp_us", "lane_id", "status"))
    runs: dict[int, list[tuple[float, str]]] = {}
    for stamp, ids, words in zip(stamps, lanes, states, strict=True):
        for lane, word in zip(ids, words, strict=True):
            runs.setdefault(lane, []).append(((stamp - stamps[0]) / 1e6, _LETTERS.get(word, "")))
    return runs


def _read(path: Path) -> TrackTable:
    with refusing_damage(TrackError, path, "log of 123D"):
        names, kinds, values = _boxes(path)
        values[:, 1:3] -= _drawn(path).frame
        return box_table(path, names, kinds, values, ego=EGO)


def _read_signals(layout: NetLayout, road: Road, path: Path) -> tuple[Programme | None, list[str]]:
    with refusing_damage(MapError, path, "lights of 123D"):
        ids = _drawn(path).lane_ids()
        runs = {ids[lane]: run for lane, run in _lights(path).items() if lane in ids}
        return lane_programme(layout, road, runs, path.parent.name)


def _name(path: Path) -> str:
    """Name of a log by its folder, of a map by its file."""
    return path.absolute().parent.name if path.name in (PY123D_LOG, MAP) else path.stem


def _tracks(path: Path) -> Path | None:
    return log if (log := path.with_name(PY123D_LOG)).is_file() and path.name in (PY123D_LOG, MAP) else None


PY123D_MAP = MapFormat(
    is_mine=is_py123d_map, read=_read_road, tracks=_tracks, name=_name, asks_for="--tracks LOG/sync.arrow"
)
PY123D = Dataset(
    is_mine=is_py123d,
    read=with_notes(_read),
    recordings=own_maps("py123d", _name),
    files=lambda path: (path / PY123D_LOG if path.is_dir() else path,),
    name=lambda path, files: _name(files[0]),
    within=within_map,
    signals=_read_signals,
)
