from __future__ import annotations

import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from scex_sumo.base.errors import UsageError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.commonroad import road_elements
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.formats.commonroad.tracks import read_commonroad_tracks
from scex_sumo.geometry.polylines import distances
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path

reader = pytest.importorskip("commonroad.common.file_reader")


@pytest.fixture(scope="module")
def file(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (written,) = EXPORTERS.load("commonroad")(
        Request(run=run, futures=(2,), out=tmp_path_factory.mktemp("cr"))
    )
    return written


def test_the_road_read_back_is_the_same(run: Run, file: Path) -> None:
    road, back = Request(run=run, futures=(2,)).road, read_map(file)
    assert back.lanes.keys() == road.lanes.keys()
    for i, lane in road.lanes.items():
        other = back.lanes[i]
        for name in ("kind", "successors", "left", "right", "adjacent_left", "adjacent_right"):
            assert getattr(other, name) == getattr(lane, name), name
        assert other.speed_limit_mps == pytest.approx(lane.speed_limit_mps, abs=1e-6)
        for name in ("left_bound", "right_bound", "centreline"):
            assert distances(getattr(other, name), getattr(lane, name)).max() < 1e-6


def test_the_states_read_back_are_the_same(run: Run, file: Path) -> None:
    rows, states = read_commonroad_tracks(file)[0].vehicles, run.states(2)
    assert len(rows.labels) == run.scene.vehicles
    for k, label in enumerate(rows.labels):
        v = int(np.flatnonzero(run.scene.track_ids == int(label))[0])
        mine = rows.track == k
        np.testing.assert_allclose(rows.x[mine], states.x[v], atol=1e-8)
        np.testing.assert_allclose(rows.y[mine], states.y[v], atol=1e-8)
        np.testing.assert_allclose(rows.speed[mine], states.speed[v], atol=1e-8)
        np.testing.assert_allclose(np.cos(rows.psi_rad[mine]), np.cos(states.heading[v]), atol=1e-8)


def test_commonroad_io_reads_an_ego_s_task_from_the_seed_scene_on(run: Run, tmp_path: Path) -> None:
    track = int(run.scene.track_ids[0])
    request = Request(run=run, futures=(2,), out=tmp_path, ego=track)
    (file,) = EXPORTERS.load("commonroad")(request)
    scenario, tasks = reader.CommonRoadFileReader(str(file)).open()
    (task,) = tasks.planning_problem_dict.values()
    now = run.states(2)[0, 9]
    np.testing.assert_allclose(task.initial_state.position, [now.x, now.y], atol=1e-8)
    assert track not in {obstacle.obstacle_id for obstacle in scenario.dynamic_obstacles}
    first = scenario.dynamic_obstacles[0]
    assert first.initial_state.time_step == 0 and first.prediction.final_time_step == 30
    with pytest.raises(UsageError, match="--ego 999: not in the seed scene"):
        EXPORTERS.load("commonroad")(Request(run=run, futures=(2,), out=tmp_path, ego=999))


def test_commonroad_io_reads_the_intersection_with_its_arms_and_turns(run: Run, file: Path) -> None:
    network = reader.CommonRoadFileReader(str(file)).open()[0].lanelet_network
    lanes = Request(run=run, futures=(2,)).road.lanes
    (intersection,) = network.intersections
    assert len(intersection.incomings) == 4
    for arm in intersection.incomings:
        after = {i for entry in arm.incoming_lanelets for i in lanes[entry].successors}
        turns = (arm.outgoing_right, arm.outgoing_straight, arm.outgoing_left)
        assert set.union(*turns) == after and all(turns)
        ends = [np.diff(lanes[min(turn)].centreline, axis=0)[[0, -1]] @ (1, 1j) for turn in turns]
        right, straight, left = (np.angle(end / begin) for begin, end in ends)
        assert right < straight < left


def shown_by_sumo(net: Path, folder: Path, steps: int) -> dict[str, list[str]]:
    """State of each light of a net at each step from time 0 on."""
    names = {logic.get("id", "") for logic in ET.parse(net).getroot().iter("tlLogic")}
    events = [f'<timedEvent type="SaveTLSStates" source="{name}" dest="states.xml"/>' for name in names]
    (folder / "events.add.xml").write_text(f"<additional>{''.join(events)}</additional>")
    options = ["-n", str(net), "-a", "events.add.xml", "--step-length", "0.1", "--end", str(steps / 10)]
    subprocess.run(
        [program("sumo"), *options], check=True, capture_output=True, env=environment(), cwd=folder
    )
    shown: dict[str, list[str]] = {name: [] for name in names}
    for state in ET.parse(folder / "states.xml").getroot().iter("tlsState"):
        shown[state.get("id", "")].append(state.get("state", ""))
    return shown


@pytest.mark.parametrize("ego", [False, True])
def test_commonroad_io_reads_lights_that_show_what_sumo_shows(
    lit_run: Run, tmp_path: Path, *, ego: bool
) -> None:
    track = int(lit_run.scene.track_ids[0]) if ego else None
    (file,) = EXPORTERS.load("commonroad")(Request(run=lit_run, futures=(0,), out=tmp_path, ego=track))
    network = reader.CommonRoadFileReader(str(file)).open()[0].lanelet_network
    seed_step, steps = (0 if ego else 9), 1200
    shown = shown_by_sumo(lit_run.net.path, tmp_path, steps)
    colours = {"r": "RED", "y": "YELLOW", "g": "GREEN", "G": "GREEN"}
    turns = {"l": "LEFT", "t": "LEFT", "s": "STRAIGHT", "r": "RIGHT"}
    links = [
        link for link in ET.parse(lit_run.net.path).getroot().iter("connection") if link.get("tl") is not None
    ]
    for link in links:
        (lane,) = lit_run.net.lanes.lanelets(f"{link.get('from')}_{link.get('fromLane')}")
        lights = [
            network.find_traffic_light_by_id(i) for i in network.find_lanelet_by_id(lane).traffic_lights
        ]
        turn = turns[link.get("dir", "")]
        (light,) = [x for x in lights if x.direction.name == "ALL" or turn in x.direction.name]
        letters = [state[int(link.get("linkIndex", ""))] for state in shown[link.get("tl", "")]]
        read = [light.get_state_at_time_step(seed_step + t).name for t in range(steps)]
        assert light.active and read == [colours[letter] for letter in letters]
    assert len({c for link in links for c in shown[link.get("tl", "")]}) > 5


def test_commonroad_crime_computes_its_wttc_on_an_export_with_lights(lit_run: Run, tmp_path: Path) -> None:
    configuration = pytest.importorskip("commonroad_crime.data_structure.configuration")
    measure = pytest.importorskip("commonroad_crime.measure")
    (file,) = EXPORTERS.load("commonroad")(Request(run=lit_run, futures=(0,), out=tmp_path))
    scenario, _ = reader.CommonRoadFileReader(str(file)).open(lanelet_assignment=True)
    ego, *others = (vehicle.obstacle_id for vehicle in scenario.dynamic_obstacles)
    settings = configuration.CriMeConfiguration()
    settings.update(ego_id=ego, sce=scenario)
    assert min(measure.WTTC(settings).compute(other, 9) for other in others) > 0.0


def test_each_arm_of_a_roundabout_has_an_intersection_and_no_id_is_used_twice() -> None:
    elements, used = road_elements(read_map(example_path("roundabout")), taken=range(40_000))
    crossings = [element for element in elements if element.tag == "intersection"]
    assert [len(element) for element in crossings] == [2, 2, 2, 2]  # ring and arm; lanes side by side are one
    assert len(used) == sum(1 for e in elements for _ in (e, *e.iter("incoming")))
