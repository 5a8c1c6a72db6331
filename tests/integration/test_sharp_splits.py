"""Sharp splits of a SUMO net: drivers of SUMO go on as there, and bodies that touch there are the net's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.extrapolation.loop.crashes import touch_in_simulation, uncounted
from tests.runs import extrapolate
from tests.seeds import seed_of, standing, states_of, steady

NODES = """<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/>
 <node id="c" x="200" y="0" type="traffic_light"/>
 <node id="d" x="200" y="100"/><node id="e" x="300" y="0"/></nodes>"""
EDGES = """<edges><edge id="ab" from="a" to="b" spreadType="right"/>
 <edge id="bc" from="b" to="c" numLanes="2" shape="100,3.2 200,3.2"/>
 <edge id="cd" from="c" to="d"/><edge id="ce" from="c" to="e"/></edges>"""
ROUTES = """<routes><vType id="car" sigma="0" speedFactor="1" speedDev="0"/>
 <vehicle id="left" type="car" depart="0" departPos="29.5" departSpeed="13">
  <route edges="ab bc cd"/></vehicle>
 <vehicle id="next" type="car" depart="0" departPos="8" departSpeed="10">
  <route edges="ab bc ce"/></vehicle></routes>"""
CONFIG = """<configuration><input><net-file value="n.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><end value="60"/><step-length value="0.1"/></time></configuration>"""


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("splits")
    for name, content in (("n.nod.xml", NODES), ("e.edg.xml", EDGES), ("r.rou.xml", ROUTES)):
        (folder / name).write_text(content)
    words = ["-n", "n.nod.xml", "-e", "e.edg.xml", "-o", "n.net.xml"]
    run_program("netconvert", *words, folder=folder, file_bytes=0)
    (folder / "mine.sumocfg").write_text(CONFIG)
    return folder / "mine.sumocfg"


def test_a_driver_of_sumo_stays_on_the_lane_of_a_fork_that_it_is_on(config: Path, tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(config, time=5.0)
    states = extrapolate(scene, models="sumo:own", futures=1, out=tmp_path / "out").states(0)[:, -30:]
    assert scene.future is not None
    there = scene.future[:, :30]
    assert np.hypot(states.x - there.x, states.y - there.y).max() < 0.01
    assert np.abs(states.heading - there.heading).max() < 0.01
    assert states.y[0, -1] - states.y[1, -1] > 3.0, "the test has lost its meaning: both are on one lane"


def touching(heading: float, kind: str = "simulation") -> scex_sumo.SeedScene:
    """A vehicle that closes in on a corner of one that stands aslant, 1.5 m beside its way."""
    two = (0.0, 0.0, 0.0, 10.0), (20.0, 1.5, heading, 0.0)
    return seed_of(
        standing(states_of(*two)),
        track_ids=np.arange(2),
        future=steady(*two, time_s=0.1 * np.arange(1, 18)),
        future_valid=np.ones((2, 17), dtype=np.bool_),
        source={"kind": kind},
    )


def test_bodies_that_touch_aslant_as_sumo_drives_never_collide() -> None:
    assert touch_in_simulation(touching(0.5)) == [(0, 1)]
    assert uncounted(touching(0.5)).tolist() == [[False, True], [True, False]]


def test_a_recording_and_a_rear_end_collision_in_sumo_count() -> None:
    assert touch_in_simulation(touching(0.5, kind="recording")) == []
    assert touch_in_simulation(touching(0.0)) == []
