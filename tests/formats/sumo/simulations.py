"""Simulations that tests make with SUMO's own programs, and their truth in a process of its own."""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.extrapolation.processes.pool import in_other_process

ROUTES = """<routes>
 <vType id="car" vClass="passenger" length="4.3" width="1.75"/><vType id="truck" vClass="truck"/>
 <vType id="bike" vClass="bicycle"/>
 <flow id="f" type="car" begin="0" end="90" period="3" from="A0A1" to="C1C2" departLane="best"/>
 <flow id="t" type="truck" begin="0" end="90" period="9" from="C0B0" to="A1A2"/>
 <flow id="b" type="bike" begin="0" end="90" period="9" from="B2B1" to="A0B0"/>
 <personFlow id="f" begin="0" end="90" period="10"><walk from="A0A1" to="C1C2"/></personFlow>
</routes>"""
OVERTAKES = """<routes>
 <vType id="slow" sigma="0" maxSpeed="4" speedDev="0"/><vType id="fast" sigma="0" speedDev="0"/>
 <trip id="slow" type="slow" depart="0" from="A0A1" to="A1A2" departLane="1"/>
 <trip id="fast" type="fast" depart="6" from="A0A1" to="A1A2" departLane="1" departSpeed="8"/>
</routes>"""
CONFIG = """<configuration>
 <input><net-file value="g.net.xml"/><route-files value="r.rou.xml"/>{files}</input>
 <time><end value="{end}"/><step-length value="{step}"/></time>
 <processing>{processing}</processing><output>{output}</output>
 <random_number><seed value="5"/></random_number>
</configuration>"""
# One of each kind of element that makes SUMO write a file.
OUTPUTS = """<additional>
 <inductionLoop id="e1" lane="A0A1_1" pos="5" period="10" file="e1.xml"/>
 <laneAreaDetector id="e2" lane="A0A1_1" pos="5" endPos="20" period="10" file="e2.xml"/>
 <instantInductionLoop id="i" lane="A0A1_1" pos="9" file="instant.xml"/>
 <entryExitDetector id="e3" period="10" file="e3.xml">
  <detEntry lane="A0A1_1" pos="1"/><detExit lane="A0A1_1" pos="30"/>
 </entryExitDetector>
 <edgeData id="edges" file="edges.xml"/><laneData id="lanes" file="lanes.xml"/>
 <vTypeProbe id="probe" type="car" period="5" file="probe.xml"/>
 <routeProbe id="routes" edge="A0A1" period="10" file="routes.xml"/>
 <timedEvent type="SaveTLSStates" source="B1" dest="lights.xml"/>
 <timedEvent type="SaveTLSSwitchTimes" source="B1" dest="switches.xml"/>
 <calibrator id="c" edge="C0B0" pos="0" period="10" output="calibrator.xml">
  <flow begin="0" end="90" route="r" type="ssm" vehsPerHour="900" speed="9"/>
 </calibrator>
 <vType id="ssm">
  <param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="ssm.xml"/>
 </vType>
 <route id="r" edges="C0B0 B0B1"/><include href="more.add.xml"/>
</additional>"""


@dataclass(frozen=True)
class Simulation:
    config: Path
    net: Path
    routes: Path


@dataclass(frozen=True)
class Truth:
    """State of a simulation, by name: x, y, angle, speed, length, width; lights for each step from then."""

    vehicles: dict[str, list[float]]
    bicycles: list[str]
    persons: list[str]
    lights: dict[str, list[str]]


def run(name: str, *options: object, cwd: Path) -> None:
    command = [program(name), *map(str, options)]
    subprocess.run(command, cwd=cwd, check=True, capture_output=True, env=environment())


def start_words(config: str = "mine.sumocfg") -> list[str]:
    """The words that start a configuration without a window and without a word."""
    return [program("sumo"), "-c", config, "--no-step-log", "--no-warnings", "--xml-validation", "never"]


def write_grid(
    folder: Path,
    *,
    lights: str = "static",
    routes: str = ROUTES,
    step_s: float = 0.1,
    processing: str = "",
    files: str = "",
    output: str = "",
    end: float = 90,
    net_options: tuple[str, ...] = (),
) -> Simulation:
    """Write a grid with traffic, people and bicycles, and its configuration."""
    (folder / "g.net.xml").write_bytes(_net(lights, net_options))
    (folder / "r.rou.xml").write_text(routes)
    config = folder / "mine.sumocfg"
    config.write_text(CONFIG.format(step=step_s, processing=processing, files=files, output=output, end=end))
    return Simulation(config=config, net=folder / "g.net.xml", routes=folder / "r.rou.xml")


@cache
def _net(lights: str, options: tuple[str, ...]) -> bytes:
    grid = ["--grid", "--grid.number", 3, "--grid.length", 80, "-L", 2, "-o", "g.net.xml", *options]
    sides = ["--sidewalks.guess", "--crossings.guess", "-j", "traffic_light", "--tls.default-type", lights]
    with tempfile.TemporaryDirectory() as folder:
        run("netgenerate", *grid, *sides, cwd=Path(folder))
        return Path(folder, "g.net.xml").read_bytes()


def in_sumo(file: Path, time_s: float, *, steps: int = 0) -> Truth:
    """Simulate a configuration, or an empty net, with SUMO's own options until a time."""
    return in_other_process(partial(_truth, file, time_s, steps), where="in the truth", died="no truth")


def _truth(file: Path, time_s: float, steps: int) -> Truth:
    import libsumo

    given = ["-c", str(file)] if file.suffix == ".sumocfg" else ["-n", str(file), "--step-length", "0.1"]
    libsumo.start(["sumo", *given, "--no-step-log", "--no-warnings", "--xml-validation", "never"])
    if time_s > libsumo.simulation.getTime():
        libsumo.simulationStep(time_s)
    cars, persons = libsumo.vehicle, list(libsumo.person.getIDList())
    is_bike = {v: cars.getVehicleClass(v) == "bicycle" for v in cars.getIDList()}
    vehicles = {
        v: [*cars.getPosition(v), cars.getAngle(v), cars.getSpeed(v), cars.getLength(v), cars.getWidth(v)]
        for v in is_bike
        if not is_bike[v]
    }
    lights: dict[str, list[str]] = {t: [] for t in libsumo.trafficlight.getIDList()}
    for _ in range(steps):
        for t in lights:
            lights[t].append(libsumo.trafficlight.getRedYellowGreenState(t))
        libsumo.simulationStep()
    return Truth(vehicles, [v for v in is_bike if is_bike[v]], persons, lights)
