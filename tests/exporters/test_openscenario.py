from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from scex_sumo.exporters.openscenario import axle_offset
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run
from tests.exporters.openscenario_reader import box_centres

pytest.importorskip("scenariogeneration")


@pytest.fixture(scope="module")
def files(run: Run, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    out = tmp_path_factory.mktemp("osc")
    return EXPORTERS.load("openscenario")(Request(run=run, futures=(0, 2), out=out))


def test_the_box_of_each_vehicle_is_where_the_future_has_it_at_every_step(
    run: Run, files: list[Path]
) -> None:
    for future, file in ((0, files[1]), (2, files[2])):
        states = run.states(future)
        boxes = box_centres(file, 0.1 * np.arange(states.shape[1]))
        for v, track in enumerate(run.scene.track_ids):
            x, y, heading = boxes[f"vehicle{track}"].T
            assert np.hypot(x - states.x[v], y - states.y[v]).max() < 0.001  # issue: 0.05 m
            assert np.abs(np.sin(heading - states.heading[v])).max() < 1e-6


def test_the_ego_has_start_and_goal_and_no_trajectory_and_time_begins_at_the_seed_scene(
    run: Run, tmp_path: Path
) -> None:
    ego = int(run.scene.track_ids[0])
    files = EXPORTERS.load("openscenario")(Request(run=run, futures=(1,), out=tmp_path, ego=ego))
    root, states = ET.parse(files[1]).getroot(), run.states(1)
    actors = {e.get("entityRef") for e in root.iter("EntityRef")}
    assert (
        actors >= {f"vehicle{track}" for track in run.scene.track_ids[1:]} and f"vehicle{ego}" not in actors
    )
    (init,) = (e for e in root.iter("Private") if e.get("entityRef") == f"vehicle{ego}")
    goal = init.find(".//AcquirePositionAction/Position/WorldPosition")
    assert goal is not None
    back = axle_offset(run.scene.types[0], float(run.scene.length[0]))
    assert float(goal.get("x", "nan")) == pytest.approx(
        states.x[0, -1] - back * np.cos(states.heading[0, -1]), abs=1e-5
    )
    boxes = box_centres(files[1], np.zeros(1))
    for v, track in enumerate(run.scene.track_ids[1:], 1):
        x, y, _ = boxes[f"vehicle{track}"][0]
        assert np.hypot(x - run.scene.now.x[v], y - run.scene.now.y[v]) < 0.001


def test_a_parameter_delays_a_trajectory_of_the_pair_alike_in_all_players(run: Run, tmp_path: Path) -> None:
    pair = tuple(int(track) for track in run.scene.track_ids[:2])
    files = EXPORTERS.load("openscenario-1.3")(
        Request(run=run, futures=(0,), out=tmp_path, encounter=(pair[0], pair[1]))
    )
    root = ET.parse(files[1]).getroot()
    header = root.find("FileHeader")
    assert header is not None and header.get("revMinor") == "3"
    declared = {e.get("name"): e.get("value") for e in root.iter("ParameterDeclaration")}
    assert declared == {f"vehicle{track}_delay": "0" for track in pair}
    states, delay, seen = run.states(0), 0.5, 1.2
    for v, track in enumerate(pair):
        (group,) = (
            one
            for one in root.iter("ManeuverGroup")
            if one.find(f"Actors/EntityRef[@entityRef='vehicle{track}']") is not None
        )
        begins, timing = group.find(".//SimulationTimeCondition"), group.find(".//Timing")
        assert begins is not None and begins.get("value") == f"$vehicle{track}_delay"
        assert timing is not None and timing.get("domainAbsoluteRelative") == "relative"
        scale, offset = float(timing.get("scale", "nan")), float(timing.get("offset", "nan"))
        since = seen - delay  # the trajectory's own time, from the start of its event
        for own_time in (since * scale + offset, offset + scale * since):  # esmini, scenario_simulator_v2
            x, y, _ = box_centres(files[1], np.array([own_time]))[f"vehicle{track}"][0]
            then = states[v, 7]
            assert np.hypot(x - then.x, y - then.y) < 0.001
