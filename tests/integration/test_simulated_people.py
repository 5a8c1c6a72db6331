"""SUMO's drivers wait for persons of a simulation as they do there, whichever way these cross."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.results.obstacles import replaying
from tests.runs import extrapolate

NODES = '<nodes><node id="A" x="0" y="0"/><node id="M" x="100" y="0"/><node id="B" x="200" y="0"/></nodes>'
EDGES = "".join(
    f'<edge id="{one}{two}" from="{one}" to="{two}" numLanes="1" sidewalkWidth="2"/>'
    for one, two in ("AM", "MB", "BM", "MA")
)
CROSSING = '<connections><crossing node="M" edges="AM MA" priority="true"/></connections>'
ROUTES = """<routes><vType id="car" sigma="0" speedFactor="1"/>
 <vehicle id="1" type="car" depart="0" departPos="20" departSpeed="10"><route edges="AM MB"/></vehicle>
 <vehicle id="2" type="car" depart="0" departPos="20" departSpeed="10"><route edges="BM MA"/></vehicle>
 <person id="p" depart="0" departPos="{from_m}"><walk from="{start}" to="{end}" arrivalPos="{to_m}"/></person>
</routes>"""
CONFIG = """<configuration><input><net-file value="n.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><end value="60"/><step-length value="0.1"/></time>
 <processing><pedestrian.striping.dawdling value="0"/></processing></configuration>"""


@pytest.fixture(params=[("AM", 92, "MA", 20), ("MA", 8, "AM", 80)], ids=["north", "south"])
def config(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    start, from_m, end, to_m = request.param
    routes = ROUTES.format(start=start, from_m=from_m, end=end, to_m=to_m)
    files = {
        "n.nod.xml": NODES,
        "e.edg.xml": f"<edges>{EDGES}</edges>",
        "c.con.xml": CROSSING,
        "r.rou.xml": routes,
    }
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    words = ["-n", "n.nod.xml", "-e", "e.edg.xml", "-x", "c.con.xml", "-o", "n.net.xml"]
    run_program("netconvert", *words, folder=tmp_path, file_bytes=0)
    (tmp_path / "mine.sumocfg").write_text(CONFIG)
    return tmp_path / "mine.sumocfg"


def test_drivers_wait_for_a_person_that_comes_to_a_crossing(config: Path, tmp_path: Path) -> None:
    stopped = False
    for time_s in (2.0, 3.0, 5.0):
        scene = scex_sumo.read_seed(config, time=time_s)
        assert scene.future is not None and scene.obstacles is not None and scene.obstacles.walks[0].edges
        run = extrapolate(scene, models=["sumo:own"], futures=1, steps=40, out=tmp_path / f"{time_s}")
        ours, theirs = run.states(0)[:, -40:], scene.future[:, :40]
        np.testing.assert_allclose(ours.x, theirs.x, atol=0.5, err_msg=f"{time_s} s")
        stopped |= bool((theirs.speed[:, -1] < 0.1).any())
    assert stopped, "the test has lost its meaning: nobody waits"


def test_a_person_walks_on_beside_vehicles_that_are_replayed(config: Path, tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(config, time=3.0)
    part = replaying(scene, [0])
    assert part.obstacles is not None and part.obstacles.ids == ("p", "2")
    run = extrapolate(part, models=["sumo:own"], futures=1, steps=40, out=tmp_path / "out")
    assert part.future is not None
    np.testing.assert_allclose(run.states(0)[:, -40:].x, part.future[:, :40].x, atol=0.1)  # waits as SUMO's
