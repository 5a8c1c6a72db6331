"""Futures of a simulation that the test itself steps, in process and over a port."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.formats.sumo.simulations import Simulation, in_sumo, write_grid

# The ten lines of docs/sumo.md, for both ways to drive SUMO.
EXAMPLE = """
import {module} as sumo

import scex_sumo as scex

sumo.start([{binary!r}, "-c", "mine.sumocfg", "--no-step-log", "--no-warnings", "--xml-validation", "never"])
watch = scex.watch(sumo)
while sumo.simulation.getTime() < 30:
    sumo.simulationStep()
if watch.until(lambda: sumo.vehicle.getIDCount() > 12):
    run = watch.extrapolate(children=3, models="standard_driver,sumo:EIDM", exact=False)
"""
CHECKED = """
import json
from pathlib import Path
before = {{v: sumo.vehicle.getPosition(v) for v in sumo.vehicle.getIDList()}}
assert sumo.simulation.getTime() == watch.time_s
assert run.children == 3 and run.folder.is_dir() and len(run.metrics) == 3
scene = watch.scene()
names = scene.source["vehicles"].values()
assert set(names) == {{v for v in before if sumo.vehicle.getVehicleClass(v) != "bicycle"}}
assert scene.recorded_steps.max() == 10
until = watch.time_s + 5
sumo.simulationStep(until)
after = {{v: sumo.vehicle.getPosition(v) for v in sumo.vehicle.getIDList()}}
sumo.close()
assert watch.scene().time_s == until  # nothing is lost with the connection
try:
    watch.until(lambda: False)
except scex.ScexError as error:
    print(error)
Path("after.json").write_text(json.dumps([until, after]))
"""


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return write_grid(tmp_path_factory.mktemp("grid"))


@pytest.mark.parametrize("module", ["libsumo", "traci"])
def test_a_simulation_goes_on_after_its_futures(grid: Simulation, module: str) -> None:
    import json

    from scex_sumo.base.programs import program

    code = (EXAMPLE + CHECKED).format(module=module, binary=program("sumo"))
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code], cwd=grid.config.parent, capture_output=True, text=True
    )
    assert not done.returncode, done.stderr
    assert "cannot step the simulation" in done.stdout
    until, after = json.loads((grid.config.parent / "after.json").read_text())
    alone = in_sumo(grid.config, until).vehicles
    assert {name: after[name] for name in alone} == {name: state[:2] for name, state in alone.items()}
