from __future__ import annotations

import subprocess
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.results.run import Run
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from tests.formats.sumo.simulations import OVERTAKES, in_sumo, write_grid
from tests.runs import extrapolate


def replay(folder: Path, *words: object) -> list[ET.Element]:
    """The steps that SUMO writes."""
    command = [program("sumo"), *map(str, words), "--fcd-output", "seen.xml"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, env=environment())
    return ET.parse(folder / "seen.xml").getroot().findall("timestep")


def test_sumo_goes_on_from_the_future_s_last_step(run: Run, tmp_path: Path) -> None:
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(1,), out=tmp_path))
    first, *_, last = replay(tmp_path, "-c", file, "--end", 3)
    states, moved = run.states(1)[:, -1], 0
    vehicles = {element.get("id"): element for element in first}
    assert len(vehicles) >= run.scene.vehicles - 1  # who is off the lanes is left out, and the README says so
    for v, track in enumerate(run.scene.track_ids):
        if (element := vehicles.get(str(track))) is not None:
            half = run.scene.length[v] / 2
            x = states.x[v] + half * np.cos(states.heading[v])
            y = states.y[v] + half * np.sin(states.heading[v])
            off = np.hypot(float(element.get("x", "nan")) - x, float(element.get("y", "nan")) - y)
            assert off < 0.1 * states.speed[v] + 0.5  # at most a step later
            moved += states.speed[v] > 1
    assert moved and len(last)
    assert "EIDM" in (tmp_path / "README.md").read_text()


def test_floating_car_data_are_replayed_by_sumo_with_the_types_beside_them(run: Run, tmp_path: Path) -> None:
    files = EXPORTERS.load("fcd")(Request(run=run, futures=(1,), out=tmp_path / "one.fcd.xml"))
    assert [file.name for file in files] == ["one.fcd.xml", "one.types.add.xml"]
    words = ("--device.fcd-replay.files", files[0], "--step-length", 0.1, "--end", 3)
    replay(tmp_path, "-n", run.net.path, "-a", files[1], *words)
    given, seen = (
        {
            (one.get("time"), v.get("id")): float(v.get("x", "nan"))
            for one in ET.parse(file).iter("timestep")
            for v in one
        }
        for file in (files[0], tmp_path / "seen.xml")
    )
    both = [(given[key], x) for key, x in seen.items() if key in given]
    assert len(both) > 20 * run.scene.vehicles
    assert np.median(np.abs(np.diff(both))) < 0.5


def test_a_future_that_ends_in_a_deadlock_is_dissolved(tmp_path: Path) -> None:
    """Vehicles that braked within the intersection stand in each other's way: ten of twelve stood."""
    scene = read_seed(example_path("urban_intersection"))
    run = extrapolate(scene, futures=64, steps=30, out=tmp_path / "run")
    assert staying(run, (3,), tmp_path) == []


def staying(run: Run, futures: tuple[int, ...], folder: Path) -> list[dict[str, str]]:
    """Vehicles that SUMO has not brought to the end of their routes after 150 s."""
    vehicles = []
    for file in EXPORTERS.load("sumo")(Request(run=run, futures=futures, out=folder / "sumo")):
        vehicles += [vehicle.attrib for vehicle in replay(file.parent, "-c", file.name, "--end", 150)[-1]]
    return vehicles


ROUTES = """<routes><vType id="car" sigma="0"/>
 <vehicle id="north" type="car" depart="0" departSpeed="8"><route edges="A0A1 A1B1 B1B2"/></vehicle>
 <vehicle id="west" type="car" depart="0" departSpeed="8"><route edges="C1B1 B1B0 B0A0"/></vehicle>
 <vehicle id="lorry" type="car" depart="0" departSpeed="8" arrivalPos="60">
  <route edges="B0B1 B1C1"/></vehicle>
</routes>"""


STILL = '<pedestrian.striping.dawdling value="0"/>'
BUSY = """<routes><vType id="car" sigma="0" speedDev="0"/>
 <flow id="e" type="car" begin="0" end="7" period="2" from="A0A1" to="C1C2" departLane="best"/>
 <flow id="w" type="car" begin="0" end="7" period="2" from="C0B0" to="A1A2" departLane="best"/>
 <personFlow id="p" begin="0" end="7" period="3"><walk from="A0A1" to="C1C2"/></personFlow>
</routes>"""


def test_lights_by_traffic_and_persons_go_on_as_in_the_simulation(tmp_path: Path) -> None:
    simulation = write_grid(tmp_path, lights="actuated", routes=BUSY, processing=STILL)
    seed = read_seed(simulation.config, time=8.0)
    run = extrapolate(seed, models=["sumo:own"], futures=1, steps=30, out=tmp_path / "run")
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=tmp_path / "sumo"))
    told, exported = in_sumo(simulation.config, 11.0, steps=300), in_sumo(file, 11.0, steps=300)
    assert exported.lights == told.lights
    assert any(len(set(states)) > 4 for states in told.lights.values())
    assert sorted(exported.persons) == sorted(told.persons) == ["p.0", "p.1", "p.2"]
    assert {name: state[0] for name, state in exported.vehicles.items()} == pytest.approx(
        {name: state[0] for name, state in told.vehicles.items()}, abs=0.01
    )
    shown = ET.parse(file.with_name("net.net.xml")).getroot().findall("tlLogic")
    assert {light.get("type") for light in shown} == {"actuated"}


def test_a_simulation_goes_on_as_it_does_in_sumo(tmp_path: Path) -> None:
    simulation = write_grid(tmp_path, routes=ROUTES, end=60)
    run = extrapolate(
        read_seed(simulation.config, time=5.0), models=["sumo:own"], futures=1, steps=30, out=tmp_path / "run"
    )
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=tmp_path / "sumo"))
    told = []
    for config in (simulation.config, file):
        words = ("-c", config.name, "--end", 38, "--precision", 6, "--step-length", 0.1)
        steps = replay(config.parent, *words, "--xml-validation", "never")
        steps = [step for step in steps if float(step.get("time", "nan")) > 8.05][:290]
        told.append(
            [{v.get("id"): (v.get("lane"), float(v.get("pos", "nan"))) for v in step} for step in steps]
        )
    simulated, exported = told
    assert set(exported[0]) == {"north", "west", "lorry"} and len(exported) == 290
    state = ET.parse(file.with_name("state.xml")).getroot()
    assert [vehicle.get("type") for vehicle in state.iter("vehicle")] == ["car"] * 3
    for now, then in zip(exported, simulated, strict=True):
        assert now.keys() == then.keys()
        for name, (lane, along_m) in now.items():
            assert lane == then[name][0] and abs(along_m - then[name][1]) < 0.01


def test_the_future_of_another_driver_goes_on_though_a_lane_change_of_one_step_is_drawn(
    tmp_path: Path,
) -> None:
    """Drawn over 3 s, one is not where SUMO has saved it; another one comes to its third edge."""
    turns = '<vehicle id="turns" type="fast" depart="0" departSpeed="13" departPos="30">'
    turns += '<route edges="C2C1 C1C0 C0B0"/></vehicle><trip'
    simulation = write_grid(tmp_path, routes=OVERTAKES.replace("<trip", turns, 1), step_s=1.0)
    seed = read_seed(simulation.config, time=10.0)
    run = extrapolate(seed, models=["standard_driver"], futures=1, steps=30, out=tmp_path / "run")
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=tmp_path / "sumo"))
    last, first = run.states(0)[:, -1], replay(file.parent, "-c", file.name)[0]
    there = {v.get("id"): (float(v.get("x", "nan")), float(v.get("y", "nan"))) for v in first}
    assert there.keys() == {"fast", "slow", "turns"}
    for v, name in enumerate(run.scene.names):
        ahead = run.scene.length[v] / 2 + 0.1 * last.speed[v]
        front = last.x[v] + ahead * np.cos(last.heading[v]), last.y[v] + ahead * np.sin(last.heading[v])
        assert np.hypot(*np.subtract(there[name], front)) < 0.5


def test_a_person_with_the_name_of_a_vehicle_walks_on(tmp_path: Path) -> None:
    walk = '<personFlow id="e" begin="0" end="1" period="3"><walk from="A0A1" to="C1C2"/></personFlow>'
    routes = BUSY.replace("</routes>", f"{walk}</routes>")
    simulation = write_grid(tmp_path, routes=routes, processing=STILL)
    seed = read_seed(simulation.config, time=8.0)
    run = extrapolate(seed, models=["sumo:own"], futures=1, steps=30, out=tmp_path / "run")
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=tmp_path / "sumo"))
    exported = in_sumo(file, 11.0)
    assert sorted(exported.persons) == ["e.0", "p.0", "p.1", "p.2"]
    assert "e.0" in exported.vehicles


def test_the_type_of_a_single_vehicle_stays_its_own(tmp_path: Path) -> None:
    """SUMO makes ``car@north`` of ``car`` where an attribute of one vehicle is set."""
    slow = '<vType id="car@north" sigma="0" maxSpeed="3"/>'
    routes = ROUTES.replace("<vType", f"{slow}<vType", 1).replace(
        '"north" type="car"', '"north" type="car@north"'
    )
    simulation = write_grid(tmp_path, routes=routes.replace('"8"', '"3"'), end=60)
    run = extrapolate(
        read_seed(simulation.config, time=5.0), models=["sumo:own"], futures=1, steps=30, out=tmp_path / "run"
    )
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=tmp_path / "sumo"))
    state = ET.parse(file.with_name("state.xml")).getroot()
    limit = {kind.get("id"): kind.get("maxSpeed") for kind in state.iter("vType")}
    found = {v.get("id"): limit[v.get("type")] for v in state.iter("vehicle")}
    assert float(found.pop("north") or "nan") == 3
    assert found == {"west": None, "lorry": None}


def test_a_bus_stands_at_its_stop_also_beside_a_bicycle_that_takes_part(tmp_path: Path) -> None:
    """SUMO has saved nothing of a road user whose model drives it: all are set up anew."""
    routes = """<routes><vType id="car" sigma="0"/><vType id="bike" vClass="bicycle"/>
     <vehicle id="bus" type="car" depart="0" departSpeed="8"><route edges="B0B1 B1C1"/>
      <stop lane="B1C1_1" endPos="40" duration="5" until="20"/></vehicle>
     <vehicle id="bike" type="bike" depart="0"><route edges="B2B1 B1A1"/></vehicle></routes>"""
    simulation = write_grid(tmp_path, routes=routes)
    seed = read_seed(simulation.config, time=7.0)
    run = extrapolate(seed, models=["sumo:own"], futures=1, steps=50, vru="model", out=tmp_path / "run")
    (file,) = EXPORTERS.load("sumo")(Request(run=run, futures=(0,), out=tmp_path / "sumo"))
    steps = replay(file.parent, "-c", file.name, "--end", 12, "--xml-validation", "never")
    times = [float(step.get("time", "nan")) for step in steps for v in step.iterfind("vehicle[@pos='40.00']")]
    assert min(times) == pytest.approx(0.1) and max(times) == pytest.approx(8.1, abs=0.2)  # 20 s are 8 s on
