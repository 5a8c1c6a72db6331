"""Traffic on the left is traffic on the right, seen in a mirror: the same futures to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.converters.net.mirror import mirrored_content
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_model import load_scenes
from scex_sumo.generators.synthetic import sumo_population
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.roads.mirror import drawn_on, mirrored_road, mirrored_scene, mirrored_states
from scex_sumo.scene import Plan, SceneHistory, SeedScene, VehicleIndex
from tests.converters.sumo_roads import load
from tests.lanelet2sumo.judge.report import check_net
from tests.runs import extrapolate


@pytest.fixture(scope="module")
def scene() -> SeedScene:
    return scex_sumo.read_seed(scex_sumo.example_path("urban_intersection"))


def same(run: Run, image: Run) -> None:
    for future in range(run.info["futures"]):
        ours, theirs = run.states(future), mirrored_states(image.states(future))
        for name in ("x", "y", "heading", "speed"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    for table in ("encounters", "metrics", "worst"):
        rows, others = (one.table(f"{table}.parquet").to_pylist() for one in (run, image))
        others = [{**row, "y": -row["y"]} if row.get("y") is not None else row for row in others]
        assert str(rows) == str(others), table  # NaN is like NaN


@pytest.mark.parametrize("models", ["likely", "sumo:EIDM,cuts_in", "graph_predictor,runs_red"])
def test_futures_of_a_map_and_of_its_image_are_each_other_s_image(
    models: str, scene: SeedScene, tmp_path: Path
) -> None:
    image = mirrored_scene(scene)
    assert image.road is not None and image.road.left_hand
    runs = [
        extrapolate(one, models=models.split(","), futures=6, out=tmp_path / name, world="sumo")
        for one, name in ((scene, "right"), (image, "left"))
    ]
    same(*runs)
    assert 'lefthand="true"' in runs[1].net.path.read_text()


def test_people_decide_alike_on_both_sides(scene: SeedScene, tmp_path: Path) -> None:
    ours, theirs = (
        scex_sumo.extrapolate(one, models="standard_driver", futures=2, report=False, out=tmp_path / name)
        for one, name in ((scene, "right"), (mirrored_scene(scene), "left"))
    )
    for name in ("track_id", "other_id", "probability", "what", "how"):
        assert ours.table("pairs.parquet")[name].equals(theirs.table("pairs.parquet")[name]), name
    assert ours.decision == theirs.decision


def test_a_driver_of_the_user_s_sees_the_map_as_it_is(
    scene: SeedScene, tmp_path: Path, registered_models: dict[str, object]
) -> None:
    seen: list[tuple[bool, float]] = []

    @scex_sumo.behavior("looks")
    class Looks:
        def plan(self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Any) -> Plan:
            seen.append((road.left_hand, float(history.scene.now.y.mean())))
            rest = np.repeat(history.now.x[vehicles.future, vehicles.vehicle][:, None], 30, axis=1)
            y = np.repeat(history.now.y[vehicles.future, vehicles.vehicle][:, None], 30, axis=1)
            return Plan(x=rest, y=y, heading=np.zeros_like(rest), speed=np.zeros_like(rest))

    image = mirrored_scene(scene)
    extrapolate(image, models=["looks", "standard_driver"], futures=2, steps=5, out=tmp_path / "own")
    assert set(seen) == {(True, float(image.now.y.mean()))}


def test_a_net_of_the_image_is_the_image_of_the_net(scene: SeedScene, tmp_path: Path) -> None:
    assert scene.road is not None
    image = mirrored_road(scene.road)
    nets = [convert(one, tmp_path / f"{k}.net.xml") for k, one in enumerate((scene.road, image))]
    assert load(nets[1].path) == ""
    assert check_net(nets[1].path, image, nets[1].lanes).problems() == []
    back = mirrored_content(nets[1].path.read_text())
    assert back == mirrored_content(mirrored_content(nets[0].path.read_text()))


@pytest.mark.parametrize(
    "draw",
    [
        partial(sumo_population, vehicles=5, seed=3, cache=False),
        partial(generated_scene, model=load_scenes(), vehicles=5, seed=3),
    ],
)
def test_vehicles_are_placed_alike_on_both_sides(draw: Callable[[Road], SeedScene], scene: SeedScene) -> None:
    assert scene.road is not None
    right, left = drawn_on(scene.road, draw), drawn_on(mirrored_road(scene.road), draw)
    np.testing.assert_array_equal(right.now.y, -left.now.y)
    assert left.road is not None and left.road.left_hand


NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="500" y="0"/></nodes>'
EDGES = '<edges><edge id="ab" from="a" to="b" numLanes="1" width="4"/></edges>'
RIDERS = """<routes><route id="r" edges="ab"/>
 <vType id="rider" vClass="motorcycle" sigma="0" latAlignment="arbitrary" width="0.8" maxSpeed="20"/>
 <vType id="car" sigma="0" latAlignment="right" maxSpeed="9"/>
 <vehicle id="1" type="rider" route="r" depart="0" departPos="40" departSpeed="12" departPosLat="1.2"/>
 <vehicle id="2" type="car" route="r" depart="0" departPos="70" departSpeed="8" departPosLat="right"/>
 <vehicle id="3" type="rider" route="r" depart="0" departPos="71" departSpeed="8" departPosLat="1.1"/>
</routes>"""
CONFIG = """<configuration><input><net-file value="{side}.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><end value="30"/><step-length value="0.1"/></time><output><save-state.times value="4"/>
 <save-state.files value="{side}.state.xml"/></output>
 <processing><lateral-resolution value="0.8"/></processing></configuration>"""


def simulation(folder: Path, side: str) -> Path:
    for name, content in (("n.nod.xml", NODES), ("e.edg.xml", EDGES), ("r.rou.xml", RIDERS)):
        (folder / name).write_text(content)
    words = ["-n", "n.nod.xml", "-e", "e.edg.xml", "-o", f"{side}.net.xml", "--lefthand", str(side == "left")]
    assert run_program("netconvert", *words, folder=folder, file_bytes=0) == ()
    config = folder / f"{side}.sumocfg"
    config.write_text(CONFIG.format(side=side))
    return config


@pytest.mark.parametrize("side", ["right", "left"])
def test_riders_pass_each_other_in_a_lane_as_in_sumo_on_both_sides(side: str, tmp_path: Path) -> None:
    config = simulation(tmp_path, side)
    scene = scex_sumo.read_seed(config, time=2.0)
    assert scene.road is not None and scene.road.left_hand is (side == "left") and scene.future is not None
    run = extrapolate(scene, models=["sumo:own"], futures=1, steps=50, out=tmp_path / "out")
    ours, theirs = run.states(0)[:, -50:], scene.future[:, :50]
    np.testing.assert_allclose(ours.x, theirs.x, atol=0.01)
    np.testing.assert_allclose(ours.y, theirs.y, atol=0.01)
    assert (ours.x[0] - ours.x[1]).min() < 0 < (ours.x[0] - ours.x[1]).max()  # it passes


@pytest.mark.parametrize("side", ["right", "left"])
def test_saved_states_have_vehicles_on_their_side_of_the_lane(side: str, tmp_path: Path) -> None:
    config = simulation(tmp_path, side)
    assert run_program("sumo", "-c", config.name, folder=tmp_path, file_bytes=0) == ()
    saved = scex_sumo.read_seed(tmp_path / f"{side}.net.xml", tracks=tmp_path / f"{side}.state.xml")
    simulated = scex_sumo.read_seed(config, time=4.0)
    np.testing.assert_allclose(saved.now.y, simulated.now.y, atol=0.02)
    run = extrapolate(saved, models=["sumo:own"], futures=1, steps=30, out=tmp_path / "out")
    assert simulated.future is not None
    np.testing.assert_allclose(run.states(0).y[:, -1], simulated.future.y[:, 29], atol=0.05)
    np.testing.assert_allclose(run.states(0).x[:, -1], simulated.future.x[:, 29], atol=0.05)
