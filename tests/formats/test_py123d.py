"""Logs of 123D: its Arrow files, here written in the published structure, run to futures.

If the package itself is installed, its own writer makes one log, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import shapely

from scex_sumo import read_map, read_seed
from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.datasets.recordings import read_recorded
from tests.formats import streets
from tests.runs import extrapolate

msgpack = pytest.importorskip("msgpack")

CENTRE_M = 1.5  # of the ego, ahead of its IMU
EGO = {
    "length": 4.9,
    "width": 1.9,
    "center_to_imu_se3": [CENTRE_M, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    "rear_axle_to_imu_se3": [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
}


def packed(value: Any) -> bytes:
    def array(one: Any) -> Any:
        raw = {b"__ndarray__": True, b"dtype": one.dtype.str, b"shape": one.shape, b"data": one.tobytes()}
        return raw

    return bytes(msgpack.packb(value, default=array, use_bin_type=True))


def write(path: Path, columns: dict[str, Any], meta: dict[str, Any], prefix: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table({f"{prefix}{name}": values for name, values in columns.items()})
    table = table.replace_schema_metadata({b"metadata": packed(meta)})
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)


def lane_features(x: float, y: float) -> dict[int, dict[str, Any]]:
    features = {}
    for i in streets.SUCCESSORS:
        left, right, centre = streets.bound(i, 1, x, y), streets.bound(i, -1, x, y), streets.centre(i, x, y)
        lines = [np.column_stack([line, np.zeros(len(line))]) for line in (left, right, centre)]
        features[i] = {
            "lane_type": 3 if i == 6 else 2,
            "lane_group_id": i,
            "left_boundary": lines[0],
            "right_boundary": lines[1],
            "centerline": lines[2],
            "left_lane_id": streets.LEFT[i],
            "right_lane_id": streets.RIGHT[i],
            "predecessor_ids": streets.PREDECESSORS[i],
            "successor_ids": streets.SUCCESSORS[i],
            "speed_limit_mps": 13.0,
            "outline": lines[0],
        }
    return features


def write_map(
    path: Path, *, x: float = 0.0, y: float = 0.0, per_log: bool = True, features: Any = None
) -> None:
    rows = []
    for i, one in (features or lane_features(x, y)).items():
        ring = np.concatenate([streets.bound(i, 1, x, y), streets.bound(i, -1, x, y)[::-1]])
        rows.append((i, 0, one, shapely.Polygon(ring)))
        rows.append((i, 1, {"intersection_id": 1 if i in streets.INSIDE else None}, shapely.Polygon(ring)))
    walk = np.array([[60.0, -2, 0], [63, -2, 0], [63, 9, 0], [60, 9, 0]]) + np.array([x, y, 0])
    rows.append((20, 3, {"outline": walk}, shapely.Polygon(walk)))
    rows.append((21, 7, {"stop_zone_type": 3, "lane_ids": [2], "outline": walk}, shapely.Polygon(walk)))
    rows.append((22, 9, {"road_line_type": 10}, shapely.LineString(streets.bound(1, -1, x, y))))
    rows.append((23, 10, {"speed_bump_type": 0}, shapely.Polygon(walk)))
    far = lane_features(x + 5000.0, y)[1] | {"successor_ids": [], "left_lane_id": None}
    rows.append((30, 0, far, shapely.LineString(streets.centre(1, x + 5000.0, y))))
    numbers, layers, parts, shapes = zip(*rows, strict=True)
    columns = {
        "object_id": pa.array(numbers, pa.int64()),
        "map_layer": pa.array(layers, pa.int8()),
        "features": [packed(part) for part in parts],
        "wkb": [shapely.to_wkb(shape) for shape in shapes],
    }
    write(path, columns, {"map_is_per_log": per_log, "dataset": "made", "location": "here"})


def write_log(folder: Path, *, x: float = 0.0, y: float = 0.0, label: str = "NuPlan") -> Path:
    steps = range(len(streets.TIMES))
    users = [user for user in streets.USERS if user[0] != "ego"]
    labels = {"car": 0, "pedestrian": 2}
    boxes = [
        [
            [streets.driven(start, speed)[k] + x, side + y, 0.0, 1.0, 0.0, 0.0, 0.0, 4.4, 1.9, 1.5]
            for _, _, start, side, speed in users
        ]
        for k in steps
    ]
    columns = {
        "timestamp_us": [10**15 + 10**5 * k for k in steps],
        "bounding_box_se3": boxes,
        "track_token": [[user[0] for user in users] for _ in steps],
        "label": [[labels[user[1]] for user in users] for _ in steps],
        "velocity_3d": [[[user[4], 0.0, 0.0] for user in users] for _ in steps],
    }
    word = f"py123d.parser.registry.{label}BoxDetectionLabel"
    prefix = "box_detections_se3"
    write(folder / f"{prefix}.arrow", columns, {"box_detection_label_class": word}, f"{prefix}.")
    _, _, start, side, speed = next(user for user in streets.USERS if user[0] == "ego")
    fine = np.arange(0.0, 6.01, 0.01)  # the ego's poses come at 100 Hz
    ego = {
        "timestamp_us": [10**15 + round(1e6 * t) for t in fine],
        "imu_se3": [[start + speed * t - CENTRE_M + x, side + y, 0.0, 1.0, 0.0, 0.0, 0.0] for t in fine],
        "dynamic_state_se3": [[speed, *([0.0] * 8)]] * len(fine),
    }
    write(folder / "ego_state_se3.arrow", ego, EGO, "ego_state_se3.")
    lights = {
        "timestamp_us": columns["timestamp_us"],
        "lane_id": [[1, 77]] * len(steps),
        "status": [[4 if k < 5 else 2 if k < 30 else 0, 2] for k in steps],
    }
    write(folder / "traffic_light_detections.arrow", lights, {}, "traffic_light_detections.")
    of_map = {"dataset": "made", "location": "here", "map_is_per_log": False}
    log = {"dataset": "made", "split": "made_val", "log_name": folder.name, "map_metadata": of_map}
    write(folder / "sync.arrow", {"timestamp_us": columns["timestamp_us"]}, log, "sync.")
    return folder / "sync.arrow"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    folder = tmp_path / "logs/made_val/one"
    write_map(folder / "map.arrow")
    return write_log(folder)


def test_a_map_has_lanes_signs_lights_lines_and_intersections(log: Path) -> None:
    road = read_map(log)
    assert road.name == "one" and road.lanes[6].kind == "bicycle"
    assert (road.lanes[1].successors, road.lanes[1].left, road.lanes[1].speed_limit_mps) == ((3, 5), 2, 13.0)
    np.testing.assert_allclose(road.lanes[5].left_bound, streets.bound(5, 1))
    assert [(rule.kind, rule.lanes) for rule in road.regulations] == [
        ("yield", (2,)),
        ("traffic_light", (1,)),
    ]
    assert [area.kind for area in road.areas] == ["crosswalk"]
    assert [line.subtype for line in road.markings] == ["solid"]


def test_a_log_runs_to_its_futures(log: Path, tmp_path: Path) -> None:
    scene = read_seed(log, time=2.0)
    assert scene.vehicles == 3 and sorted(scene.length.tolist()) == [4.4, 4.4, 4.9]
    assert scene.obstacles is not None and sorted(scene.obstacles.types) == ["parked", "pedestrian"]
    run = extrapolate(scene, futures=2, out=tmp_path / "out", steps=10)
    np.testing.assert_allclose(run.states(1).x[:, 9], scene.now.x, atol=1e-9)


def test_a_city_s_map_is_cut_around_the_log_and_far_coordinates_become_local(tmp_path: Path) -> None:
    x, y = 664_300.0, 3_998_700.0
    write_map(tmp_path / "maps/made/made_here.arrow", x=x, y=y, per_log=False)
    path = write_log(tmp_path / "logs/made_val/two", x=x, y=y)
    assert 30 in read_map(tmp_path / "maps/made/made_here.arrow").lanes
    road, scene = read_map(path), read_seed(path, time=2.0)
    assert road.lanes.keys() == streets.SUCCESSORS.keys()
    np.testing.assert_allclose(road.lanes[1].centreline[0], [300.0, 700.0], atol=1e-6)
    assert scene.vehicles == 3 and abs(scene.now.y - 701.0).max() < 3.0


@pytest.mark.parametrize("key", [*lane_features(0.0, 0.0)[1]])
@pytest.mark.parametrize("value", ["gone", None, "x", -1, [[1.0]], np.zeros(3), np.full((3, 2), np.nan)])
def test_a_lane_with_a_bad_field_ends_in_a_road_or_one_line(log: Path, key: str, value: Any) -> None:
    features = lane_features(0.0, 0.0)
    features[1][key] = value
    if isinstance(value, str) and value == "gone":
        del features[1][key]
    write_map(log.with_name("map.arrow"), features=features)
    try:
        assert len(read_map(log).lanes) >= 6
    except MapError as error:
        assert str(log) in str(error) and "\n" not in str(error)


@pytest.mark.parametrize(
    ("name", "column"),
    [
        *(("box_detections_se3", c) for c in ("timestamp_us", "bounding_box_se3", "track_token", "label")),
        *(("ego_state_se3", c) for c in ("timestamp_us", "imu_se3", "dynamic_state_se3")),
    ],
)
def test_a_log_without_a_column_is_one_line(log: Path, name: str, column: str) -> None:
    path = log.with_name(f"{name}.arrow")
    with pa.OSFile(str(path), "rb") as source:
        table = pa.ipc.open_file(source).read_all().drop_columns([f"{name}.{column}"])
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)
    with pytest.raises(TrackError, match=f"no {column} in it"):
        read_recorded([log])


def test_the_package_s_own_files_are_read(tmp_path: Path) -> None:
    datatypes = pytest.importorskip("py123d.datatypes", reason="py123d is not installed here")
    from py123d.api.map.arrow.arrow_map_writer import ArrowMapWriter
    from py123d.geometry import Polyline3D

    writer = ArrowMapWriter(True, tmp_path / "maps", tmp_path / "logs")
    writer.reset(datatypes.MapMetadata(dataset="made", location="here", map_has_z=True, map_is_per_log=False))
    for i, one in lane_features(0.0, 0.0).items():
        lines = {
            key: Polyline3D.from_array(one[key]) for key in ("left_boundary", "right_boundary", "centerline")
        }
        rest = {key: value for key, value in one.items() if key not in (*lines, "outline", "lane_type")}
        kind = datatypes.LaneType(one["lane_type"])
        writer.write_map_object(datatypes.Lane(object_id=i, lane_type=kind, **lines, **rest))
    writer.close()
    road = read_map(tmp_path / "maps/made/made_here.arrow")
    assert road.lanes.keys() == streets.SUCCESSORS.keys() and road.lanes[1].successors == (3, 5)
    np.testing.assert_allclose(road.lanes[1].left_bound, streets.bound(1, 1))
