"""People in exports, replayed or with models of their own: each reader finds them again."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.converters.tracks.road_users import OBSTACLE_SIZES
from scex_sumo.exporters.commonroad import write_commonroad
from scex_sumo.exporters.openscenario import write_openscenario
from scex_sumo.exporters.request import Request
from scex_sumo.exporters.tracks import write_fcd_files
from scex_sumo.formats.sumo.fcd import read_fcd
from scex_sumo.results.run import Run
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Obstacles, SeedScene
from tests.runs import extrapolate
from tests.seeds import people_of, steady

KINDS = Counter({"car": 3, "pedestrian": 3, "bicycle": 1})


def people_beside(scene: SeedScene) -> Obstacles:
    """Three people on foot and a cyclist, 60 m and more from the first vehicle, all on their way north."""
    kinds, (x, y) = ("pedestrian",) * 3 + ("bicycle",), (scene.now.x[0] + 60.0, scene.now.y[0])
    walking = [(x + 5.0 * k, y, np.pi / 2, speed) for k, speed in enumerate((1.3, 1.4, 1.2, 4.0))]
    length, width = np.array([OBSTACLE_SIZES[kind] for kind in kinds]).T
    states = steady(*walking, time_s=np.arange(-HISTORY_STEPS, 31) * STEP_S)
    return people_of(states, *kinds, length=length, width=width)


@pytest.fixture(scope="module", params=["replay", "model"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Three cars, three people on foot and a cyclist."""
    vehicles = scex.synthetic_seed(
        scex.example_path("urban_intersection"), vehicles=3, like="recorded", seed=5, cache=False
    )
    scene = replace(vehicles, obstacles=people_beside(vehicles))
    out = tmp_path_factory.mktemp(request.param) / "out"
    return extrapolate(scene, futures=2, steps=10, out=out, vru=request.param)


def test_openscenario_has_pedestrians_and_bicycles(run: Run, tmp_path: Path) -> None:
    (file,) = write_openscenario(Request(run=run, futures=(1,), out=tmp_path))[1:2]
    root = ET.parse(file).getroot()
    vehicles = Counter(one.get("vehicleCategory") for one in root.iter("Vehicle"))
    walkers = Counter(one.get("pedestrianCategory") for one in root.iter("Pedestrian"))
    assert vehicles + walkers == KINDS
    assert len(list(root.iter("FollowTrajectoryAction"))) == 7
    named = Counter(str(one.get("name")).rstrip("0123456789P") for one in root.iter("ScenarioObject"))
    people = {"pedestrian": 3, "bicycle": 1} if run.info["seed_scene"].get("people") else {"other": 4}
    assert named == {"vehicle": 3, **people}


def test_commonroad_io_reads_people(run: Run, tmp_path: Path) -> None:
    reader = pytest.importorskip("commonroad.common.file_reader")
    (file,) = write_commonroad(Request(run=run, futures=(1,), out=tmp_path))
    scenario, _ = reader.CommonRoadFileReader(str(file)).open()
    assert Counter(one.obstacle_type.value for one in scenario.dynamic_obstacles) == KINDS


def test_floating_car_data_read_back_have_people(run: Run, tmp_path: Path) -> None:
    (file, _) = write_fcd_files(Request(run=run, futures=(1,), out=tmp_path / "one.fcd.xml"))
    assert Counter(one.tag for one in ET.parse(file).getroot()[0]) == {"vehicle": 4, "person": 3}
    tracks, _ = read_fcd(file)
    assert len(tracks.vehicles.labels) == 3
    assert Counter(tracks.others.types) == KINDS - Counter(car=3)
