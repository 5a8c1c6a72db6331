"""Futures as a data set of ScenarioNet, read back and by the rules of MetaDrive."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.converters.datasets.recordings import read_recorded
from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.formats.scenarionet import unpickle
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.results.run import Run
from tests.lanelet2sumo.judge.report import check_net


@pytest.fixture(scope="module")
def files(run: Run, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    request = Request(
        run=run, futures=(2, 0), out=tmp_path_factory.mktemp("sn"), ego=int(run.scene.track_ids[1])
    )
    return EXPORTERS.load("scenarionet")(request)


def load(path: Path) -> Any:
    with path.open("rb") as file:
        return unpickle(file)


def test_the_states_read_back_are_the_same(run: Run, files: list[Path]) -> None:
    rows, states = read_recorded([files[0]])[0].vehicles, run.states(2)
    assert rows.tracks == run.scene.vehicles
    for k, label in enumerate(rows.labels):
        v = int(np.flatnonzero(run.scene.track_ids == int(label))[0])
        mine = rows.track == k
        np.testing.assert_allclose(rows.x[mine], states.x[v], atol=1e-9)
        np.testing.assert_allclose(rows.y[mine], states.y[v], atol=1e-9)
        np.testing.assert_allclose(rows.speed[mine], states.speed[v], atol=1e-9)
        np.testing.assert_allclose(np.cos(rows.psi_rad[mine]), np.cos(states.heading[v]), atol=1e-9)
        assert set(rows.length[mine]) == {run.scene.length[v]}


def test_the_road_read_back_has_the_same_lanes(run: Run, files: list[Path], tmp_path: Path) -> None:
    road, back = Request(run=run, futures=(2,)).road, read_map(files[0])
    driven = road.vehicle_lanes
    assert back.vehicle_lanes.keys() == driven.keys()
    for i, lane in driven.items():
        other = back.lanes[i]
        for name in ("successors", "predecessors", "left", "right", "adjacent_left", "adjacent_right"):
            assert getattr(other, name) == getattr(lane, name), (i, name)
        np.testing.assert_allclose(other.centreline, lane.centreline, atol=1e-9)
        assert other.speed_limit_mps == pytest.approx(lane.speed_limit_mps)
        assert other.width_m == pytest.approx(lane.width_m, abs=0.3)
    assert not check_net(convert(back, tmp_path / "back.net.xml").path, back).problems()


def test_a_scenario_has_what_metadrive_checks(files: list[Path]) -> None:
    scenario = pickle.loads(files[0].read_bytes())
    assert {
        "tracks",
        "version",
        "id",
        "dynamic_map_states",
        "map_features",
        "length",
        "metadata",
    } <= scenario.keys()
    assert scenario["metadata"]["ts"].shape == (scenario["length"],)
    assert {"metadrive_processed", "coordinate", "ts"} <= scenario["metadata"].keys()
    for name, track in scenario["tracks"].items():
        assert track["type"] in ("VEHICLE", "PEDESTRIAN", "CYCLIST")
        assert track["metadata"]["object_id"] == name
        valid = track["state"]["valid"]
        assert valid.any()
        for values in track["state"].values():
            assert len(values) == scenario["length"] and values.ndim in (1, 2)
            assert abs(values[~valid]).sum() == 0
    for feature in scenario["map_features"].values():
        assert isinstance(feature["type"], str)
        if feature["type"].startswith("LANE"):
            near = np.mean(feature["polyline"], axis=0)[:2] - np.mean(feature["polygon"], axis=0)
            assert np.hypot(*near) < 100.0
