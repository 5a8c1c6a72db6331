"""A simulation of one's own that is assessed while it runs: it steps as if nobody watched."""

from __future__ import annotations

import pytest

from tests.command import script
from tests.formats.sumo.simulations import Simulation, start_words, write_grid


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return write_grid(tmp_path_factory.mktemp("grid"))


def ran(grid: Simulation, code: str) -> str:
    done = script(f"START = {start_words()}\n{code}", cwd=grid.config.parent)
    assert not done.returncode, done.stderr
    return done.stdout


WATCHED = """
import warnings
import libsumo as sumo
import scex_sumo as scex

def states(watched):
    told = []
    def called(risk):
        told.append(risk)
        if len(told) == 2:
            sumo.vehicle.remove(sorted(sumo.vehicle.getIDList())[0])
        if len(told) == 3:
            raise ValueError("mine")
    sumo.start(START)
    sumo.simulationStep(20)
    if watched:
        watch = scex.watch(sumo)
        watch.every(1.0, called, wait=True, futures=2, models="constant_velocity")
    for step in range(41):
        if not watched and step in (11,):
            sumo.vehicle.remove(sorted(sumo.vehicle.getIDList())[0])
        sumo.simulationStep()
    after = {v: sumo.vehicle.getPosition(v) for v in sumo.vehicle.getIDList()}
    if watched:
        assert watch.risk().time_s == 24.1
        assert watch.risk().vehicles and watch.skipped == 0
        last = watch.risk()
        sumo.close()
        assert watch.risk().pairs == last.pairs  # nothing is lost with the connection
        watch.close()
        assert [risk.time_s for risk in told] == [20.1, 21.1, 22.1, 23.1, 24.1]
    else:
        sumo.close()
    return after

with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    watched = states(True)
assert any("the callback failed: ValueError: mine" in str(w.message) for w in caught), caught
assert watched == states(False)
"""


def test_callbacks_may_act_and_fail_and_the_simulation_steps_as_without_a_watch(grid: Simulation) -> None:
    ran(grid, WATCHED)
