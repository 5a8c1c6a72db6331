"""A user's configuration as a seed scene: the simulation itself is the judge."""

from __future__ import annotations

import dataclasses
import gzip
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from scex_sumo.base.errors import MapError, ScexError, SimulationError, TrackError
from scex_sumo.base.sumo.programs import program
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.formats.sumo.scenario import options_of, simulate, user_sumo
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene
from scex_sumo.world.batch import RunningBatch
from scex_sumo.world.sumo import SumoWorld
from tests.formats.sumo.simulations import OUTPUTS, Simulation, in_sumo, run, write_grid
from tests.runs import extrapolate

TIME_S = 40.0


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return write_grid(tmp_path_factory.mktemp("grid"))


@pytest.fixture(scope="module")
def scene(grid: Simulation) -> SeedScene:
    return read_seed(grid.config, time=TIME_S)


def test_vehicles_are_where_sumo_has_them(grid: Simulation, scene: SeedScene) -> None:
    truth = in_sumo(grid.config, TIME_S)
    names = scene.source["vehicles"]
    assert scene.vehicles == len(truth.vehicles) > 10
    for v, track in enumerate(scene.track_ids):
        x, y, angle, speed, length, width = truth.vehicles[names[str(track)]]
        heading = np.radians(90.0 - angle)
        centre = [x - np.cos(heading) * length / 2, y - np.sin(heading) * length / 2]
        np.testing.assert_allclose([scene.now.x[v], scene.now.y[v]], centre, atol=1e-6)
        np.testing.assert_allclose(
            [scene.now.speed[v], scene.length[v], scene.width[v]], [speed, length, width]
        )
    assert set(scene.types) == {"car", "truck"} and scene.recorded_steps.max() == 10
    assert scene.future is not None and scene.future.shape[1] == 80


def test_pedestrians_and_bicycles_are_obstacles(grid: Simulation, scene: SeedScene) -> None:
    truth = in_sumo(grid.config, TIME_S)
    assert scene.obstacles is not None and set(scene.obstacles.types) == {"pedestrian", "bicycle"}
    now = scene.obstacles.present[:, 10].sum()
    assert now == len(truth.persons) + len(truth.bicycles) > 2


def write_switching(folder: Path) -> Simulation:
    """Write a grid whose fixed lights change their programmes at 43 s and at 64 s (WAUT)."""
    grid = write_grid(folder, files='<additional-files value="w.add.xml"/>')
    lights = ElementTree.parse(grid.net).getroot().findall("tlLogic")
    for light in lights:
        light.set("programID", "night")
        for phase in light:
            phase.set("duration", "4")
    night = "".join(ElementTree.tostring(light, encoding="unicode") for light in lights)
    here = "".join(f'<wautJunction wautID="w" junctionID="{light.get("id")}"/>' for light in lights)
    switches = '<wautSwitch time="43" to="night"/><wautSwitch time="64" to="0"/>'
    waut = f'<WAUT id="w" refTime="0" startProg="0">{switches}</WAUT>{here}'
    (folder / "w.add.xml").write_text(f"<additional>{night}{waut}</additional>")
    return grid


@pytest.mark.parametrize("kind", ["actuated", "delay_based", "NEMA", "switching"])
def test_lights_of_every_kind_go_on_as_in_the_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    grid = write_switching(tmp_path) if kind == "switching" else write_grid(tmp_path, lights=kind)
    for time_s in (TIME_S, 62.0) if kind == "switching" else (62.0,):
        scene = read_seed(grid.config, time=time_s)
        assert any("lights that do in each future what they do in the simulation" in n for n in scene.notes)
        assert scene.road is not None and scene.road.net is not None
        then = in_sumo(grid.config, time_s, steps=50).lights
        assert max(len(set(states)) for states in then.values()) > 1
        assert in_sumo(scene.road.net, 0.1, steps=50).lights == then
    shown = list[list[dict[str, str]]]()  # in batches, the first one a future with SUMO's drivers
    begin, advance = SumoWorld.begin, SumoWorld._advance

    def lights_of(world: SumoWorld) -> dict[str, str]:
        lights = world._sumo.trafficlight
        return {t.removeprefix("t0_"): lights.getRedYellowGreenState(t) for t in lights.getIDList()}

    def begun(world: SumoWorld, *arguments: Any) -> SumoWorld:
        shown.append([])
        begin(world, *arguments)
        shown[-1][:] = [lights_of(world)]
        return world

    def watched(world: SumoWorld, batch: RunningBatch) -> None:
        advance(world, batch)
        shown[-1].append(lights_of(world))

    monkeypatch.setattr(SumoWorld, "begin", begun)
    monkeypatch.setattr(SumoWorld, "_advance", watched)
    extrapolate(scene, futures=1, models=["sumo:Krauss"], out=tmp_path / "out")
    states = shown[0]
    assert [states[k][light] for light in then for k in range(31)] == [s for t in then for s in then[t][:31]]


def test_no_output_of_the_user_is_written(tmp_path: Path) -> None:
    named = "".join(
        f'<{name} value="{name}.xml"/>'
        for name in ("fcd-output", "tripinfo-output", "summary", "collision-output", "statistic-output")
    )
    named += '<save-state.times value="5"/><save-state.prefix value="state"/><log value="log.txt"/>'
    named += '<device.ssm.probability value="1"/><device.ssm.file value="device.xml"/>'
    grid = write_grid(tmp_path, files='<additional-files value="all.add.xml"/>', output=named)
    (tmp_path / "all.add.xml").write_text(OUTPUTS)
    (tmp_path / "more.add.xml").write_text(
        '<additional><inductionLoop id="m" lane="A0A1_1" pos="7" file="more.xml"/></additional>'
    )
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    scene = read_seed(grid.config, time=TIME_S)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before
    assert scene.vehicles > 10
    # SUMO itself writes all of them: the test would see it.
    run("sumo", "-c", grid.config.name, cwd=tmp_path)
    assert len(list(tmp_path.iterdir())) >= len(before) + 20


def test_a_configuration_that_does_not_load_says_why(grid: Simulation, tmp_path: Path) -> None:
    bad = tmp_path / "bad.sumocfg"
    with pytest.raises(MapError, match=r"bad\.sumocfg: no such file; check the path of the configuration"):
        options_of(bad)

    def fails(text: str, words: str, kind: type[ScexError] = MapError) -> None:
        bad.write_text(text)
        with pytest.raises(kind, match=words):
            read_seed(bad, time=5.0)

    net, here = f'<net-file value="{grid.net}"/>', "<configuration><input>{}</input></configuration>"
    fails("<configuration", "name a SUMO configuration")
    fails(here.format(""), "no <net-file>")
    fails(here.format('<net-file value="no.net.xml"/>'), "does not exist")
    fails(here.format(net + '<route-files value="no.rou.xml"/>'), "names it as <route-files>")
    fails(here.format(net + '<such-option value="1"/>'), "such-option", SimulationError)
    (tmp_path / "r.rou.xml").write_text('<routes><trip id="a" depart="0" from="nowhere" to="A0A1"/></routes>')
    fails(here.format(net + '<route-files value="r.rou.xml"/>'), "nowhere", SimulationError)
    (tmp_path / "r.rou.xml").write_bytes(gzip.compress(b"")[:10] + b"\xff" * 20)
    fails(here.format(net + '<route-files value="r.rou.xml"/>'), "no XML of SUMO can be read")
    (tmp_path / "r.rou.xml").write_text("<!DOCTYPE routes><routes/>")
    fails(here.format(net + '<route-files value="r.rou.xml"/>'), "DOCTYPE")


def test_more_traffic_than_can_be_run_is_refused_before_or_when_it_comes(
    grid: Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scaled = tmp_path / "scaled.sumocfg"
    files = f'<net-file value="{grid.net}"/><route-files value="r.rou.xml"/>'
    scaled.write_text(f'<configuration><input>{files}</input><scale value="1e9"/></configuration>')
    (tmp_path / "r.rou.xml").write_text('<routes><trip id="a" depart="0" from="A0A1" to="C1C2"/></routes>')
    with pytest.raises(MapError, match="scales the traffic by 1e9, at most 100 is run; lower scale"):
        read_seed(scaled, time=5.0)
    scaled.write_text(f"<configuration><input>{files}</input></configuration>")
    (tmp_path / "r.rou.xml").write_text('<routes><vType id="c" scale="1e9"/></routes>')
    with pytest.raises(MapError, match="scales the traffic by 1e9"):
        read_seed(scaled, time=5.0)
    for flow in ('period="1e-9"', 'period="exp(1e9)"', 'vehsPerHour="1e12"', 'number="1000000000"'):
        (tmp_path / "r.rou.xml").write_text(f'<routes><flow id="f" begin="0" end="90" {flow}/></routes>')
        with pytest.raises(MapError, match=r"flow f has \S+ departures a second, at most 1,000 are run"):
            read_seed(scaled, time=5.0)
    monkeypatch.setattr("scex_sumo.formats.sumo.scenario.MAX_VEHICLES", 5)
    with pytest.raises(SimulationError, match=r"\d+ vehicles at \S+ s, \d+ of them wait .* at most 5"):
        simulate(grid.config, (TIME_S, TIME_S))


def test_vehicles_on_lanes_without_cars_are_no_matter_of_the_origin(tmp_path: Path) -> None:
    bus = '<routes><vType id="bus" vClass="bus"/><trip id="a" type="bus" depart="0" from="A0A1" to="A1A2"/>'
    grid = write_grid(tmp_path, routes=f"{bus}</routes>")
    net = ElementTree.parse(grid.net)
    for edge in net.iter("edge"):
        if edge.get("id") == "A0A1":
            for lane in list(edge)[1:]:  # the first one is the sidewalk
                lane.attrib.pop("disallow", None)
                lane.set("allow", "bus")
    net.write(grid.net)
    with pytest.raises(
        TrackError, match=r"1 of 1 .* lanes that the map closes to cars: A0A1_1; allow"
    ) as said:
        read_seed(grid.config, time=2.0)
    assert "origin" not in str(said.value)


def test_teleporting_parked_and_waiting_vehicles_are_left_out_with_a_note(tmp_path: Path) -> None:
    routes = """<routes>
     <vehicle id="jumps" depart="0" departLane="1"><route edges="A0A1 A1B1 B1C1"/>
      <stop lane="A0A1_1" endPos="50" duration="1" jump="60"/></vehicle>
     <vehicle id="stands" depart="0" departLane="1"><route edges="C0B0 B0B1"/>
      <stop lane="C0B0_1" endPos="20" duration="500"/></vehicle>
     <vehicle id="parks" depart="0" departLane="1"><route edges="B2B1 B1B0"/>
      <stop lane="B2B1_1" endPos="40" duration="500" parking="true"/></vehicle>
     <flow id="f" begin="2" period="2" end="60" from="C0B0" to="B0B1" departLane="1"/>
    </routes>"""
    scene = read_seed(write_grid(tmp_path, routes=routes).config, time=TIME_S)
    assert any(note == "vehicles that teleport at this moment are left out: jumps" for note in scene.notes)
    assert any(note == "vehicles that are parked are left out: parks" for note in scene.notes)
    assert any(note.startswith("vehicles that wait to be inserted are left out: ") for note in scene.notes)
    assert not {"jumps", "parks"} & set(scene.source["vehicles"].values())


def test_left_hand_traffic_has_its_left_lane_on_the_left(tmp_path: Path) -> None:
    grid = write_grid(tmp_path, net_options=("--lefthand",))
    road = read_sumo_road(grid.net)
    beside = [lane for lane in road.lanes.values() if lane.left is not None]
    assert beside
    for lane in beside:
        other = road.lanes[lane.left].centreline[0] - lane.centreline[0]
        ahead = lane.centreline[-1] - lane.centreline[0]
        assert ahead[0] * other[1] - ahead[1] * other[0] > 0
    assert read_seed(grid.config, time=TIME_S).vehicles > 10


def test_rank_takes_moments_of_a_window_of_a_configuration(grid: Simulation) -> None:
    (recording,) = find_recordings([grid.config])
    loaded = load_recording(dataclasses.replace(recording, window=(20.0, 30.0)))
    times = [moment.time_s for moment in recording_moments(loaded, every_s=5.0)]
    assert times == [20.0, 25.0, 30.0]
    assert loaded.table.vehicles.stamps_ms.min() <= 19_000 and loaded.table.vehicles.stamps_ms.max() >= 35_000
    # The fixed programmes of a longer recording are still fixed.
    longer = load_recording(dataclasses.replace(recording, window=(20.0, 85.0)))
    scene = seed_at(longer, 40.0)
    assert not any("traffic lights" in note for note in scene.notes)
    assert scene.road is not None and scene.road.net is not None
    assert in_sumo(scene.road.net, 0.1, steps=60).lights == in_sumo(grid.config, 40.0, steps=60).lights


@pytest.mark.parametrize(("said", "words"), [("SUMO sumo 1.19.0", "needs 1.20"), ("", "of no known version")])
def test_an_old_sumo_of_the_user_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str, words: str
) -> None:
    monkeypatch.setenv("SUMO_HOME", str(tmp_path))
    assert user_sumo() is None  # a folder without programs
    (tmp_path / "bin").mkdir()
    own = tmp_path / "bin" / "sumo"
    own.write_text(f"#!/bin/sh\necho 'Eclipse {said}'\n")
    own.chmod(0o755)
    with pytest.raises(SimulationError, match=words):
        user_sumo()


def test_the_sumo_of_the_user_simulates(
    tmp_path: Path, grid: Simulation, scene: SeedScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "home" / "bin" / "sumo"
    own.parent.mkdir(parents=True)
    own.write_text(f'#!/bin/sh\necho ran >> {tmp_path}/calls\nexec {program("sumo")} "$@"\n')
    own.chmod(0o755)
    monkeypatch.setenv("SUMO_HOME", str(tmp_path / "home"))
    again = read_seed(grid.config, time=TIME_S)
    assert (tmp_path / "calls").read_text().count("ran") >= 3  # its version, its options, the simulation
    assert any("of SUMO_HOME" in note for note in again.notes)
    np.testing.assert_array_equal(again.history.x, scene.history.x)
