"""ScenarioNet: pickles are read as data only; a scenario goes from its file to futures."""

from __future__ import annotations

import collections
import copy
import os
import pickle
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo import find_recordings, load_recording, read_map, read_seed
from scex_sumo.base.errors import MapError, ScexError, TrackError
from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.extrapolation.job import ruled
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.formats.scenarionet import unpickle
from scex_sumo.lanelet2sumo.convert import convert
from tests.formats import streets
from tests.runs import extrapolate


@cache
def _content() -> dict[str, Any]:
    """A scenario as the converter of Waymo's data writes it."""
    features: dict[str, Any] = {}
    for i in streets.SUCCESSORS:
        line = np.column_stack([streets.centre(i), np.zeros(len(streets.centre(i)))]).astype(np.float32)
        features[str(i)] = {
            "type": "LANE_BIKE_LANE" if i == 6 else "LANE_SURFACE_STREET",
            "polyline": line,
            "speed_limit_mph": 25.0,
            "interpolating": i in streets.INSIDE,
            "width": np.full((len(line), 2), 1.75),
            "entry_lanes": streets.PREDECESSORS[i],
            "exit_lanes": streets.SUCCESSORS[i],
            "left_neighbor": [{"feature_id": streets.LEFT[i]}] if streets.LEFT[i] else [],
            "right_neighbor": [{"feature_id": streets.RIGHT[i]}] if streets.RIGHT[i] else [],
            "left_boundaries": [{"boundary_type": "ROAD_LINE_SOLID_SINGLE_WHITE"}] if i == 3 else [],
            "right_boundaries": [],
        }
    features["80"] = {"type": "STOP_SIGN", "lane": [2], "position": np.zeros(3)}
    features["81"] = {"type": "CROSSWALK", "polygon": np.array([[60.0, -2], [63, -2], [63, 9], [60, 9]])}
    features["82"] = {"type": "ROAD_LINE_BROKEN_SINGLE_WHITE", "polyline": streets.bound(1, 1)}
    count = len(streets.TIMES)
    tracks = {}
    for name, kind, x, y, speed in streets.USERS:
        valid = (0.45 if name == "12" else 0.0) <= streets.TIMES
        position = np.stack([streets.driven(x, speed), np.full(count, y), np.zeros(count)], axis=1)
        state = {
            "position": position * valid[:, None],
            "heading": np.zeros(count),
            "velocity": np.stack([np.full(count, speed), np.zeros(count)], axis=1) * valid[:, None],
            "length": np.where(valid, 4.4, 0.0)[:, None],
            "width": np.where(valid, 1.9, 0.0)[:, None],
            "height": np.where(valid, 1.5, 0.0)[:, None],
            "valid": valid,
        }
        user = "VEHICLE" if kind == "car" else "PEDESTRIAN"
        tracks[name] = {"type": user, "state": state, "metadata": {"type": user, "object_id": name}}
    tracks["90"] = tracks["15"] | {"type": "TRAFFIC_CONE"}
    words = ["LANE_STATE_UNKNOWN"] * 5 + ["LANE_STATE_STOP"] * 25 + ["LANE_STATE_GO"] * 31
    light = {"type": "TRAFFIC_LIGHT", "lane": "1", "stop_point": np.array([95.0, 0.0, 0.0])}
    return {
        "id": "a",
        "version": "1",
        "length": count,
        "metadata": {"ts": streets.TIMES.astype(np.float32), "sdc_id": "ego", "coordinate": "waymo"},
        "tracks": tracks,
        "dynamic_map_states": {"1": light | {"state": {"object_state": words}, "metadata": {}}},
        "map_features": features,
    }


def content() -> dict[str, Any]:
    return copy.deepcopy(_content())


def written(folder: Path, scenario: Any) -> Path:
    path = folder / "sd_waymo_v1_a.pkl"
    path.write_bytes(pickle.dumps(scenario, protocol=4))
    return path


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return written(tmp_path, content())


class _Call:
    """Unpickled, it would call a function."""

    def __init__(self, function: Any, *arguments: Any) -> None:
        self._call = function, arguments

    def __reduce__(self) -> Any:
        return self._call


HOSTILE = {
    "a call": _Call(os.system, "touch hacked"),
    "eval": _Call(eval, "1"),
    "an object array": np.array([{}], object),
    "a masked array": np.ma.masked_array([1.0]),
    "a class": Path("x"),
    "a record array": np.zeros(2, [("a", float)]),
    "times": np.zeros(2, "M8[s]"),
    "a getter": _Call(getattr, {}, "clear"),
    "many zeros": _Call(np.zeros, 10**12),
    "pointers of bytes": _Call(np.ndarray, (1,), "O", b"\x41" * 8),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_pickle_that_names_anything_but_plain_arrays_is_refused(name: str, tmp_path: Path) -> None:
    bad = content()
    bad["metadata"]["more"] = HOSTILE[name]
    path = written(tmp_path, bad)
    for read in (read_map, lambda file: read_recorded([file])):
        with pytest.raises(ScexError, match="no pickle that can be read"):
            read(path)
    assert not (tmp_path / "hacked").exists() and not Path("hacked").exists()


def _endless() -> list[Any]:
    one: list[Any] = []
    one += [one, one]
    return one


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_plain_arrays_and_containers_are_read_in_every_protocol(protocol: int, tmp_path: Path) -> None:
    arrays = [
        np.arange(6.0).reshape(2, 3),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.array(["a", "bc"]),
        np.array([True]),
        np.arange(3, dtype=">i4"),
        np.zeros((0, 2), np.float32),
        np.float32(2.5),
    ]
    path = tmp_path / "x"
    path.write_bytes(pickle.dumps({"a": arrays, "b": ({1, 2}, None, 3, "x", True, b"y")}, protocol))
    with path.open("rb") as file:
        back = unpickle(file)
    for one, other in zip(arrays, back["a"], strict=True):
        np.testing.assert_array_equal(np.asarray(one), np.asarray(other))
        assert np.asarray(one).dtype.kind == np.asarray(other).dtype.kind
    assert back["b"] == ({1, 2}, None, 3, "x", True, b"y")


def test_a_map_has_lanes_limits_signs_lights_and_lines(scenario: Path) -> None:
    road = read_map(scenario)
    assert road.name == "waymo_v1_a" and road.lanes[6].kind == "bicycle"
    assert (road.lanes[1].successors, road.lanes[1].left, road.lanes[3].left) == ((3, 5), 2, None)
    assert road.lanes[1].width_m == 3.5 and round(3.6 * road.lanes[1].speed_limit_mps) == 40
    assert [(rule.kind, rule.lanes) for rule in road.regulations] == [("stop", (2,)), ("traffic_light", (1,))]
    assert [line.subtype for line in road.markings] == ["dashed"]
    assert [area.kind for area in road.areas] == ["crosswalk"]


def test_a_scenario_runs_to_its_futures(scenario: Path, tmp_path: Path) -> None:
    scene = read_seed(scenario, time=2.0)
    assert scene.vehicles == 3 and set(scene.length.tolist()) == {4.4}
    assert scene.recorded_steps.tolist() == [10, 10, 10]
    run = extrapolate(scene, futures=2, out=tmp_path / "out", steps=10)
    np.testing.assert_allclose(run.states(1).x[:, 9], scene.now.x, atol=1e-9)


def test_drivers_see_its_lights_as_they_were_at_and_after_the_moment(scenario: Path, tmp_path: Path) -> None:
    scene = read_seed(scenario, time=1.0)
    assert scene.road is not None
    scene, net = ruled(scene, convert(scene.road, tmp_path / "x.net.xml"), RunSettings())
    assert net.notes[-1] == f"lights as recorded in {scenario.name}"
    assert scene.rules is not None
    lights = {passage.lanes[0]: passage.signal for passage in scene.rules.passages}
    shown = [scene.rules.signals[lights[1]].at(time_s)[0] for time_s in (0.0, 1.9, 2.1)]
    assert (shown, lights[2]) == (["r", "r", "G"], -1)


def test_empty_relations_everywhere_are_none_at_all_and_counts_of_a_defaultdict_are_read(
    tmp_path: Path,
) -> None:
    scenario = content()
    for feature in scenario["map_features"].values():
        feature |= {key: [] for key in feature if key.endswith(("_lanes", "_neighbor"))}
    scenario["map_features"]["7"] = {"type": "LANE_SURFACE_UNSTRUCTURE", "polygon": [[0, 0], [1, 0], [1, 1]]}
    scenario["metadata"]["number_summary"] = collections.defaultdict(int, {"VEHICLE": 5})
    road = read_map(written(tmp_path, scenario))
    assert (road.lanes[1].successors, road.lanes[1].left, 7 in road.lanes) == ((3, 5), 2, False)


@pytest.mark.parametrize("key", ["position", "heading", "velocity", "valid", "length", "width"])
@pytest.mark.parametrize("value", [None, "x", np.zeros(2), np.full(61, np.inf), np.full((61, 2), np.nan)])
def test_a_track_with_a_bad_field_is_one_line(key: str, value: Any, tmp_path: Path) -> None:
    bad = content()
    bad["tracks"]["11"]["state"][key] = value
    path = written(tmp_path, bad)
    try:
        table, _ = read_recorded([path])
        assert np.isfinite(table.vehicles.x).all() and (table.vehicles.length > 0.0).all()
    except TrackError as error:
        assert str(path) in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("key", [*_content()["map_features"]["1"]])
@pytest.mark.parametrize("value", [None, "x", 7, [[1]], {}, [{"feature_id": [1]}]])
def test_a_lane_with_a_bad_field_ends_in_a_road_or_one_line(key: str, value: Any, tmp_path: Path) -> None:
    bad = content()
    bad["map_features"]["1"][key] = value
    path = written(tmp_path, bad)
    try:
        assert len(read_map(path).lanes) >= 4
    except MapError as error:
        assert str(path) in str(error) and "\n" not in str(error)


def test_the_shared_scenes_have_lanes_that_meet_and_an_ego(data: Path) -> None:
    folder = data / "scenarionet"
    if not folder.is_dir():
        pytest.skip("no scenarios of ScenarioNet here")
    for recording, lanes in zip(find_recordings([folder]), (460, 358), strict=True):
        loaded = load_recording(recording)
        assert len(loaded.road.lanes) == lanes and loaded.notes == ()
        assert sum(len(lane.successors) for lane in loaded.road.lanes.values()) >= lanes
        assert any("recording vehicle ego" in finding for finding in loaded.findings)
