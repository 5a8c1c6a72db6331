"""Futures of a simulation that the test itself steps, in process and over a port."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest

from scex_sumo.base.sumo.programs import program
from tests.command import script
from tests.formats.sumo.simulations import Simulation, in_sumo, start_words, write_grid

PAGE = Path(__file__).parents[2] / "docs" / "sumo.md"
QUIET = ', "--no-step-log", "--no-warnings", "--xml-validation", "never"])'
CHECKED = """
import json
from pathlib import Path
before = {v: sumo.vehicle.getPosition(v) for v in sumo.vehicle.getIDList()}
assert sumo.simulation.getTime() == watch.time_s
assert run.futures == 3 and run.folder.is_dir() and len(run.metrics) == 3
scene = watch.scene()
names = scene.source["vehicles"].values()
assert set(names) == {v for v in before if sumo.vehicle.getVehicleClass(v) != "bicycle"}
assert scene.recorded_steps.max() == 10
until = watch.time_s + 5
sumo.simulationStep(until)
after = {v: sumo.vehicle.getPosition(v) for v in sumo.vehicle.getIDList()}
sumo.close()
assert watch.scene().time_s == until  # nothing is lost with the connection
Path("after.json").write_text(json.dumps([until, after]))
"""


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return write_grid(tmp_path_factory.mktemp("grid"))


with_libtraci = pytest.mark.skipif(importlib.util.find_spec("libtraci") is None, reason="libtraci is absent")


@pytest.mark.parametrize("module", ["libsumo", "traci", pytest.param("libtraci", marks=with_libtraci)])
def test_a_simulation_goes_on_after_its_futures(grid: Simulation, module: str) -> None:
    (example,) = re.findall(r"```python\n(import libsumo.*?)```", PAGE.read_text(), re.DOTALL)
    example = example.replace("import libsumo", f"import {module}").replace('"sumo"', repr(program("sumo")))
    example = example.replace("extrapolate(", "extrapolate(reference=None, ")
    code = example.replace("])", QUIET, 1) + CHECKED
    done = script(f"import warnings\nwarnings.simplefilter('ignore')\n{code}", cwd=grid.config.parent)
    assert not done.returncode, done.stderr
    assert "None" not in done.stdout
    until, after = json.loads((grid.config.parent / "after.json").read_text())
    alone = in_sumo(grid.config, until).vehicles
    assert {name: after[name] for name in alone} == {name: state[:2] for name, state in alone.items()}


@with_libtraci
def test_a_watch_keeps_to_its_connection_of_libtraci(grid: Simulation) -> None:
    done = script(TWO.format(start=start_words()), cwd=grid.config.parent)
    assert not done.returncode, done.stderr


TWO = """
import libtraci
import scex_sumo as scex

libtraci.start({start}, label="a")
watch = scex.watch(libtraci)
libtraci.simulationStep(30)
libtraci.start({start}, label="b")
libtraci.simulationStep(5)
assert watch.time_s == watch.scene().time_s == 30
libtraci.switch("a")
libtraci.simulationStep()
assert watch.time_s == 30.1
libtraci.close()
libtraci.switch("b")
libtraci.close()
"""

REMOVED = """
import sys
import {module} as sumo
import scex_sumo as scex

def states(watched):
    sumo.start({start})
    watch = scex.watch(sumo) if watched else None
    sumo.simulationStep(30)
    first, second, *_ = sumo.vehicle.getIDList()
    sumo.vehicle.subscribe(second, [0x40])
    sumo.vehicle.remove(first)
    sumo.simulationStep()
    assert list(sumo.vehicle.getSubscriptionResults(second)) == [0x40]
    for _ in range(20):
        sumo.simulationStep()
    if watched:
        sumo.vehicle.remove(second)
        scene = watch.scene()
        assert repr(watch).startswith("Watch('g' at 32.1 s: ")
        assert scene.time_s == 32.1 and second not in scene.source["vehicles"].values()
        assert first not in scene.source["vehicles"].values() and scene.vehicles > 5
    after = {{v: (sumo.vehicle.getPosition(v), sumo.vehicle.getSpeed(v)) for v in sumo.vehicle.getIDList()}}
    after.pop(second, None)
    sumo.close()
    return after

assert states(True) == states(False)
"""


@pytest.mark.parametrize("module", ["libsumo", "traci"])
def test_a_watched_simulation_may_lose_vehicles_and_keeps_its_subscriptions(
    grid: Simulation, module: str
) -> None:
    done = script(REMOVED.format(module=module, start=start_words()), cwd=grid.config.parent)
    assert not done.returncode, done.stderr


WRONG = """
import warnings
import libsumo as sumo
import scex_sumo as scex

def said(call):
    try:
        call()
    except scex.ScexError as error:
        print(error)

ALONE = dict(reference=None)
start = ["sumo", "-c", "mine.sumocfg", "--no-step-log", "--no-warnings", "--xml-validation", "never"]
for wrong in (sumo, None, "sumo", warnings):
    said(lambda: scex.watch(wrong))
sumo.start([*start, "--mesosim", "true"])
said(lambda: scex.watch(sumo))
sumo.close()
sumo.start([*start, "--step-length", "0.25"])
watch = scex.watch(sumo)
said(watch.scene)
while watch.time_s < 20:
    sumo.simulationStep()
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    run = watch.extrapolate(futures=2, models=["constant_velocity"], out="out", **ALONE)
print(*[w.message for w in caught], sep="\\n")
said(lambda: watch.extrapolate(futures=3, models=["constant_velocity"], out="out", **ALONE))
said(lambda: watch.extrapolate(progress=print))
said(lambda: watch.extrapolate(models=["nonsense"]))
assert sumo.simulation.getTime() == watch.time_s == 20.0
sumo.simulation.saveState("state.xml")
sumo.simulationStep(25)
sumo.simulation.loadState("state.xml")
sumo.simulationStep()
scene = watch.scene()
assert scene.time_s == watch.time_s == 20.25 and scene.vehicles > 5 and not scene.recorded_steps.any()
assert set(scene.source["vehicles"].values()) <= set(sumo.vehicle.getIDList())
sumo.simulation.step()  # which tells no listener
assert watch.scene().time_s == watch.time_s == 20.5
sumo.close()
said(lambda: scex.watch(sumo))
"""


def test_wrong_use_of_a_watch_is_an_error_in_one_line(grid: Simulation) -> None:
    done = script(WRONG, cwd=grid.config.parent)
    assert not done.returncode, done.stderr
    words = (
        "cannot read the simulation: A network was not yet constructed",
        "NoneType is no connection to SUMO; give libsumo, traci",
        "str is no connection",
        "warnings is no connection",
        "this simulation: mesoscopic",
        "no vehicle on the road at 0 s",
        "recorded at 4 Hz: interpolated to 10 Hz",
        "holds the result of another run",
        "progress: the futures run in another process",
        "unknown behavior 'nonsense'",
    )
    for word in words:
        assert word in done.stdout, (word, done.stdout)


WARM = """
import os
import warnings
import libsumo as sumo
import scex_sumo as scex

warnings.simplefilter("ignore")
sumo.start(["sumo", "-c", "mine.sumocfg", "--no-step-log", "--no-warnings", "--xml-validation", "never"])
watch = scex.watch(sumo)
sumo.simulationStep(20)
quick = dict(futures=2, models="constant_velocity", report=False, reference=None)
processes = set()
for _ in range(2):
    run = watch.extrapolate(extra=["mine:Process"], **quick)
    processes.add(run.info["rows"][-1]["value"])
    sumo.simulationStep()
assert len(processes) == 1
watch.close()
try:
    os.kill(*processes, 0)
    raise AssertionError("the process still lives")
except ProcessLookupError:
    pass
run = watch.extrapolate(extra=["mine:Process"], **quick)
assert run.info["rows"][-1]["value"] not in processes
sumo.close()
"""
PROCESS = """
import os
from dataclasses import dataclass
import scex_sumo as scex

@dataclass(frozen=True, kw_only=True)
class Process(scex.Extra):
    def after(self, work):
        return [scex.Row(name="process", value=os.getpid())]
"""


def test_further_extrapolations_of_a_watch_have_the_same_warm_process(grid: Simulation) -> None:
    (grid.config.parent / "mine.py").write_text(PROCESS)
    done = script(WARM, cwd=grid.config.parent)
    assert not done.returncode, done.stderr
