"""Vehicles of a SUMO simulation leave a future where their route ends, whoever drives them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow.compute as pc
import pytest
from pyarrow import csv

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.evaluation.sources import read_source
from scex_sumo.exporters.request import Request
from scex_sumo.exporters.tracks import write_fcd_files, write_interaction
from scex_sumo.results.tables.pairs import ends
from scex_sumo.roads.doubts import doubts_of
from tests.runs import extrapolate

NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="400" y="0"/></nodes>'
EDGES = '<edges><edge id="ab" from="a" to="b" numLanes="2"/></edges>'
# Vehicle 1 arrives in the middle of the road, 2 parks beside it, and 3 goes on.
ROUTES = """<routes><vType id="car" sigma="0" speedFactor="1"/><route id="r" edges="ab"/>
 <vehicle id="1" type="car" route="r" depart="0" departPos="50" departSpeed="12" arrivalPos="110"/>
 <vehicle id="2" type="car" route="r" depart="0" departPos="30" departSpeed="12">
  <stop lane="ab_0" endPos="90" duration="60" parking="true"/></vehicle>
 <vehicle id="3" type="car" route="r" depart="0" departPos="10" departLane="1" departSpeed="12"/></routes>"""
CONFIG = """<configuration><input><net-file value="n.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><end value="30"/><step-length value="0.1"/></time></configuration>"""


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> scex_sumo.SeedScene:
    folder = tmp_path_factory.mktemp("arrivals")
    for name, content in (("n.nod.xml", NODES), ("e.edg.xml", EDGES), ("r.rou.xml", ROUTES)):
        (folder / name).write_text(content)
    words = ["-n", "n.nod.xml", "-e", "e.edg.xml", "-o", "n.net.xml"]
    assert run_program("netconvert", *words, folder=folder, file_bytes=0) == ()
    (folder / "mine.sumocfg").write_text(CONFIG)
    return scex_sumo.read_seed(folder / "mine.sumocfg", time=2.0)


def test_drivers_of_sumo_arrive_and_park_when_they_do_in_the_simulation(
    scene: scex_sumo.SeedScene, tmp_path: Path
) -> None:
    run = extrapolate(scene, models=["sumo:own"], futures=1, steps=50, out=tmp_path / "out")
    assert scene.future_valid is not None
    there = np.isfinite(run.states(0).x[:, -50:])
    np.testing.assert_array_equal(there, scene.future_valid[:, :50])
    assert there.sum(axis=1).tolist()[2] == 50 and (there.sum(axis=1)[:2] < 50).all()


def test_vehicles_stop_in_a_scene_that_was_changed_since(scene: scex_sumo.SeedScene, tmp_path: Path) -> None:
    """SUMO's saved state is not of the changed scene: the stops are planned anew."""
    ahead = scene.history.map(lambda values: values.copy())
    ahead.x[2] += 3.0
    changed = dataclasses.replace(scene, history=ahead)
    run = extrapolate(changed, models=["sumo:own"], futures=1, steps=50, out=tmp_path / "out")
    assert scene.future_valid is not None
    there = np.isfinite(run.states(0).x[:, -50:])
    np.testing.assert_array_equal(there, scene.future_valid[:, :50])


@pytest.fixture(scope="module")
def planned(scene: scex_sumo.SeedScene, tmp_path_factory: pytest.TempPathFactory) -> scex_sumo.Run:
    out = tmp_path_factory.mktemp("planned") / "out"
    return extrapolate(scene, models=["standard_driver"], futures=2, steps=50, out=out)


def test_planned_vehicles_arrive_there_too_and_have_no_rows_afterwards(
    planned: scex_sumo.Run, tmp_path: Path
) -> None:
    states = planned.states(1)
    last = np.isfinite(states.x).sum(axis=1) - 1
    assert last[0] < states.shape[1] - 1
    assert states.x[0, last[0]] + 2.5 + 1.5 >= 110  # its front, one step before
    assert planned.tracks["x"].null_count == 2 * (states.shape[1] - 1 - last).sum()
    (file,) = write_interaction(Request(run=planned, futures=(0, 1), out=tmp_path / "t.csv"))
    rows = csv.read_csv(file)
    assert rows.num_rows == 2 * (last + 1).sum() and rows["x"].null_count == 0
    tracks, _ = read_source(planned.folder)
    assert tracks.vehicles.x.size == rows.num_rows


def test_nobody_meets_a_vehicle_that_has_left(planned: scex_sumo.Run) -> None:
    last_s = (np.isfinite(planned.states(0).x[0]).sum() - 10) / 10
    mine = pc.field("track_id") == 1
    later = planned.worst.filter(mine & (pc.field("timestamp_ms") > 1000 * (last_s + 1)))
    assert later.num_rows == 0 and planned.collisions.num_rows == 0


def test_answer_tables_and_exports_have_sumo_s_names(scene: scex_sumo.SeedScene, tmp_path: Path) -> None:
    cars = {"1": "main.1", "2": "main.2", "3": "side"}
    named = dataclasses.replace(scene, source={**scene.source, "vehicles": cars})
    run = extrapolate(named, models=["standard_driver"], futures=2, steps=20, out=tmp_path / "out")
    assert [run.name_of(track) for track in (1, 2, 3)] == list(cars.values())
    assert run.two_tracks("main.2, 3") == (2, 3)
    with pytest.raises(UsageError, match=r"needs two vehicles.*known: main\.1, main\.2, side"):
        run.two_tracks("main.2,main.9")
    rows = run.encounters.to_pylist()
    assert rows and all((row["name"], row["other_name"]) == ends(row) for row in rows)
    assert {name for row in rows for name in ends(row)} <= set(cars.values())
    fcd = write_fcd_files(Request(run=run, futures=(0,), out=tmp_path / "f.fcd.xml"))[0].read_text()
    assert all(f'id="{name}"' in fcd for name in cars.values())


def test_a_simulation_gives_no_doubt_about_vehicles_that_it_inserts_and_takes_out(
    scene: scex_sumo.SeedScene,
) -> None:
    early = scex_sumo.read_seed(Path(scene.source["simulation"]), time=0.3)
    pairs = np.triu_indices(early.vehicles, 1)
    assert (early.recorded_steps < 10).all()
    assert doubts_of(early, *pairs) == [None] * 3
