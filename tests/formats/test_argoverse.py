"""Argoverse 2: scenarios and sensor logs as published, from their files to futures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest

from scex_sumo import find_recordings, load_recording, read_map, read_seed
from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.datasets.recordings import read_recorded
from tests.formats import streets
from tests.runs import extrapolate

TYPES = {"car": "vehicle", "pedestrian": "pedestrian"}


def map_content() -> dict[str, Any]:
    def points(line: Any) -> list[dict[str, float]]:
        return [{"x": float(x), "y": float(y), "z": 0.5} for x, y in line]

    segments = {
        str(i): {
            "id": i,
            "is_intersection": i in streets.INSIDE,
            "lane_type": "BIKE" if i == 6 else "VEHICLE",
            "left_lane_boundary": points(streets.bound(i, 1)),
            "right_lane_boundary": points(streets.bound(i, -1)),
            "left_lane_mark_type": "SOLID_WHITE" if i == 3 else "DASHED_WHITE",
            "right_lane_mark_type": "NONE",
            "successors": [*streets.SUCCESSORS[i], 999],
            "predecessors": streets.PREDECESSORS[i],
            "left_neighbor_id": streets.LEFT[i],
            "right_neighbor_id": streets.RIGHT[i],
        }
        for i in streets.SUCCESSORS
    }
    crossing = {"id": 50, "edge1": points([[60, -2], [60, 9]]), "edge2": points([[63, -2], [63, 9]])}
    return {"lane_segments": segments, "pedestrian_crossings": {"50": crossing}, "drivable_areas": {}}


def columns() -> dict[str, list[Any]]:
    rows = [
        ("AV" if name == "ego" else name, TYPES[kind], step, x, y, speed, 0.0, 0.0)
        for name, kind, start, y, speed in streets.USERS
        for step, x in enumerate(streets.driven(start, speed).tolist())
    ]
    names = (
        "track_id",
        "object_type",
        "timestep",
        "position_x",
        "position_y",
        "velocity_x",
        "velocity_y",
        "heading",
    )
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A scenario's map, its tracks beside it."""
    (tmp_path / "log_map_archive_abcdefgh-1.json").write_text(json.dumps(map_content()))
    pa.parquet.write_table(pa.table(columns()), tmp_path / "scenario_abcdefgh-1.parquet")
    return tmp_path / "log_map_archive_abcdefgh-1.json"


def test_a_map_has_its_segments_with_bounds_relations_and_kinds(scenario: Path) -> None:
    road = read_map(scenario)
    assert road.name == "av2_abcdefgh" and road.lanes.keys() == streets.SUCCESSORS.keys()
    assert road.lanes[6].kind == "bicycle" and road.lanes[1].successors == (3, 5)
    np.testing.assert_allclose(road.lanes[1].left_bound, streets.bound(1, 1))
    assert (road.lanes[1].left, road.lanes[3].left, road.lanes[3].adjacent_left) == (2, None, 4)
    assert {round(3.6 * lane.speed_limit_mps) for lane in road.vehicle_lanes.values()} == {40}
    assert [area.kind for area in road.areas] == ["crosswalk"]


def test_a_scenario_runs_to_its_futures(scenario: Path, tmp_path: Path) -> None:
    scene = read_seed(scenario, time=2.0)
    assert scene.vehicles == 3 and scene.obstacles is not None
    assert sorted(scene.obstacles.types) == ["parked", "pedestrian"]
    assert set(scene.length.tolist()) == {4.6}
    run = extrapolate(scene, futures=2, out=tmp_path / "out", steps=10)
    assert run.futures == 2
    np.testing.assert_allclose(run.states(0).x[:, 9], scene.now.x, atol=1e-9)


def test_the_ego_has_a_number_sizes_have_a_note_and_what_lies_off_the_map_is_named(scenario: Path) -> None:
    (recording,) = find_recordings([scenario.parent])
    assert (recording.dataset, recording.name) == ("argoverse", "av2_abcdefgh")
    findings = "; ".join(load_recording(recording).findings)
    assert "the recording vehicle AV is vehicle 17" in findings
    assert "sizes are not recorded: car 4.6 m x 1.9 m, pedestrian 0.6 m x 0.6 m" in findings
    assert "1 of 5 vehicles are over 5 m from all mapped lanes, left out there: 16" in findings
    assert "1 vehicles that never move stand beside the lanes: parked" in findings


def boxes(*, ego: bool) -> dict[str, list[Any]]:
    """Boxes in the frame of the ego, which begins at (100, 200) of the city and drives to the north."""
    rows = []
    for name, kind, start, y, speed in streets.USERS:
        for step, x in enumerate(streets.driven(start, speed).tolist()):
            if name != "ego":
                place = (x - 11.0 * streets.TIMES[step], y)
                rows.append(
                    (step * 10**8, name, "REGULAR_VEHICLE" if kind == "car" else "PEDESTRIAN", *place)
                )
    if ego:
        rows += [(step * 10**8, "me", "EGO_VEHICLE", 1.4, 0.0) for step in range(len(streets.TIMES))]
    names = ("timestamp_ns", "track_uuid", "category", "tx_m", "ty_m")
    table = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    sizes = {"length_m": [5.0] * len(rows), "width_m": [2.0] * len(rows)}
    return table | sizes | {"qw": [1.0] * len(rows)} | {q: [0.0] * len(rows) for q in ("qx", "qy", "qz")}


def sensor_log(folder: Path, name: str, *, ego: bool) -> Path:
    count, half = len(streets.TIMES), np.sqrt(0.5)
    pose = {
        "timestamp_ns": [step * 10**8 for step in range(count)],
        "qw": [half] * count,
        "qx": [0.0] * count,
        "qy": [0.0] * count,
        "qz": [half] * count,  # 90 degrees to the left
        "tx_m": [100.0] * count,
        "ty_m": (200.0 + 11.0 * streets.TIMES).tolist(),
    }
    pa.feather.write_feather(pa.table(pose), folder / "city_SE3_egovehicle.feather")
    pa.feather.write_feather(pa.table(boxes(ego=ego)), folder / name)
    return folder / name


@pytest.mark.parametrize(
    ("name", "ego"), [("annotations_with_ego.feather", True), ("annotations.feather", False)]
)
def test_boxes_of_a_log_lie_in_the_city_with_the_ego_among_them(tmp_path: Path, name: str, ego: bool) -> None:
    table, _ = read_recorded([sensor_log(tmp_path, name, ego=ego)])
    rows = table.vehicles
    lanes = {round(float(x), 2) for x in np.unique(np.round(rows.x, 3))}
    assert rows.tracks == 5 and lanes == {100.0, 104.5, 40.0}
    np.testing.assert_allclose(rows.psi_rad, np.pi / 2.0, atol=1e-9)
    first = rows.track == rows.labels.index("11")
    np.testing.assert_allclose(rows.y[first], 220.0 + 10.0 * streets.TIMES, atol=1e-6)
    np.testing.assert_allclose(rows.vy[first], 10.0, atol=1e-6)
    me = rows.track == rows.labels.index("17")
    np.testing.assert_allclose(rows.y[me], 200.0 + (1.4 if ego else 1.42) + 11.0 * streets.TIMES, atol=1e-6)


@pytest.mark.parametrize("key", [*next(iter(map_content()["lane_segments"].values()))])
@pytest.mark.parametrize("value", [None, "x", [{"x": "y"}]])
def test_a_segment_with_a_bad_field_ends_in_a_road_or_one_line(
    scenario: Path, key: str, value: object
) -> None:
    content = map_content()
    content["lane_segments"]["1"][key] = value
    scenario.write_text(json.dumps(content))
    try:
        assert len(read_map(scenario).lanes) >= 5
    except MapError as error:
        assert str(scenario) in str(error) and "\n" not in str(error)
    del content["lane_segments"]["1"][key]
    scenario.write_text(json.dumps(content))
    with pytest.raises(MapError, match=f"no {key} in it"):
        read_map(scenario)


@pytest.mark.parametrize("name", [*columns()])
def test_tracks_without_a_column_or_with_a_bad_value_are_one_line(scenario: Path, name: str) -> None:
    path = scenario.with_name("scenario_abcdefgh-1.parquet")
    table = columns()
    missing = {other: values for other, values in table.items() if other != name}
    pa.parquet.write_table(pa.table(missing), path)
    with pytest.raises(TrackError, match=f"no {name} in it"):
        read_recorded([path])
    if name.startswith(("position", "heading")):
        empty = {**table, name: pa.nulls(len(table[name]))}
        pa.parquet.write_table(pa.table(empty), path)
        with pytest.raises(TrackError, match="of track 11 is missing"):
            read_recorded([path])
        table[name][7] = np.inf
        pa.parquet.write_table(pa.table(table), path)
        with pytest.raises(TrackError, match="of track 11 is inf"):
            read_recorded([path])


def test_the_shared_scenes_are_faithful_and_on_their_lanes(data: Path) -> None:
    folder = data / "av2"
    if not folder.is_dir():
        pytest.skip("no recordings of Argoverse 2 here")
    for recording, lanes in zip(find_recordings([folder]), (71, 150), strict=True):
        loaded = load_recording(recording)
        assert len(loaded.road.lanes) == lanes and loaded.notes == ()
        assert any("recording vehicle" in finding for finding in loaded.findings)


def test_a_table_that_states_more_rows_than_anybody_recorded_is_one_line(
    scenario: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scex_sumo.formats.argoverse.MAX_ITEMS", 100)
    with pytest.raises(TrackError, match="rows; name one scenario"):
        read_recorded([scenario.with_name("scenario_abcdefgh-1.parquet")])
    monkeypatch.setattr("scex_sumo.formats.damage.MAX_ITEMS", 100)
    with pytest.raises(TrackError, match="more than 100 values in it"):
        read_recorded([sensor_log(tmp_path, "annotations.feather", ego=False)])
