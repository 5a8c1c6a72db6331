"""Small inputs that once failed, each of a kind: what their README calls right."""

from __future__ import annotations

import shutil
import subprocess
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.sumo.programs import environment, program
from tests import command
from tests.runs import extrapolate

pytestmark = pytest.mark.filterwarnings("ignore::scex_sumo.ScexWarning")
Positions = dict[float, dict[str, tuple[float, float]]]


@pytest.fixture
def small(data: Path, tmp_path: Path) -> Path:
    """A copy of the folder, for SUMO writes beside its configurations."""
    if not (data / "small").is_dir():
        pytest.skip("the small inputs are not here")
    folder = tmp_path / "small"
    shutil.copytree(data / "small", folder)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return folder


def driven_by_sumo(configuration: Path, *options: str) -> Positions:
    """Positions of the front bumpers by time and vehicle, as SUMO alone drives."""
    out = configuration.with_suffix(".fcd.xml")
    words = [program("sumo"), "-c", configuration, "--no-step-log", "--fcd-output", out, *options]
    subprocess.run(words, check=True, capture_output=True, env=environment(), cwd=configuration.parent)
    return {
        round(float(step.attrib["time"]), 2): {
            vehicle.attrib["id"]: (float(vehicle.attrib["x"]), float(vehicle.attrib["y"]))
            for vehicle in step.iter("vehicle")
        }
        for step in ET.parse(out).getroot()
    }


def future_of_sumo(configuration: Path, time_s: float) -> tuple[scex.SeedScene, scex.States]:
    """The moment, and the future (V, 30) in which SUMO drives all."""
    scene = scex.read_seed(configuration, time=time_s)
    states = extrapolate(scene, models="sumo:own", futures=1, out=configuration.parent / "out").states(0)
    return scene, states[:, -30:]


def test_a_lanelet_of_36_centimetres_is_no_reason_to_refuse_a_map(small: Path) -> None:
    scex.convert(scex.read_map(small / "f1_stub_lanelet.osm"), small / "n.net.xml")
    assert (small / "n.net.xml").stat().st_size > 0


def test_twelve_metres_behind_a_standing_car_at_20_mps_is_tested(small: Path) -> None:
    scene = scex.read_seed(small / "f2_standing.osm", tracks=small / "f2_standing_12.csv", time=1.1)
    run = scex.extrapolate(scene, futures=8, report=False, out=small / "out")
    assert (run.decision.kind, run.decision.pair) == ("test", (1, 2))
    assert run.decision.probability > 0.9


def test_london_drives_on_the_left(small: Path) -> None:
    road = scex.read_map(small / "f3_london.osm")
    assert road.left_hand
    net = small / "n.net.xml"
    scex.convert(road, net)
    assert 'lefthand="true"' in net.read_text()


def test_in_japan_who_turns_right_waits_for_who_comes_straight_on(small: Path) -> None:
    file = small / "f3_left_hand_crossing.osm"
    scene = scex.read_seed(file, tracks=file.with_suffix(".csv"), time=1.1)
    assert scene.road is not None and scene.road.left_hand and scene.now.speed.tolist() == [12.0, 4.0]
    scex.convert(scene.road, small / "n.net.xml")
    net = ET.parse(small / "n.net.xml")
    link = {(c.attrib["from"], c.attrib["dir"]): int(c.attrib["via"].split("_")[-2]) for c in _links(net)}
    yields = {int(r.attrib["index"]): r.attrib["response"][::-1] for r in net.iter("request")}
    assert yields[link["l5", "r"]][link["l1", "s"]] == "1"
    assert yields[link["l1", "s"]][link["l5", "r"]] == "0"

    turns = {1: "likely_driver:path=straight", 2: "likely_driver:path=0"}
    run = extrapolate(scene, assign=turns, futures=96, steps=50, out=small / "out")
    waits = [run.states(future).speed[1, -1] < 3.0 for future in range(96)]
    assert np.mean(waits) > 0.5  # some take the gap

    turns = {1: "standard_driver:path=straight", 2: "standard_driver:path=0"}
    speed = extrapolate(scene, assign=turns, futures=1, steps=30, out=small / "standard").states(0).speed
    assert speed[0].min() == 12.0 and speed[1, -1] < 0.1


def _links(net: ET.ElementTree) -> list[ET.Element]:
    """Return the links between roads."""
    return [link for link in net.iter("connection") if "via" in link.attrib and link.attrib["from"][0] != ":"]


def test_overtaking_on_the_opposite_lane_is_no_doubt_but_a_pair_to_test(small: Path) -> None:
    file = small / "f4_overtaking.osm"
    scene = scex.read_seed(file, tracks=file.with_suffix(".csv"), time=2.0)
    run = scex.extrapolate(scene, futures=8, report=False, out=small / "out")
    assert (run.decision.kind, run.decision.pair) == ("test", (3, 1))


def test_a_spiral_of_nearly_constant_curvature_ends_in_seconds(small: Path) -> None:
    began = time.monotonic()
    done = command.scex("convert", small / "f6_nearly_constant_spiral.xodr", "-o", small / "n.net.xml")
    assert done.returncode == 0 or done.stderr.count("\n") == 1, done.stderr
    assert time.monotonic() - began < 60.0  # minutes and all memory before; a busy machine takes 5 s


def test_a_lane_beside_one_that_widens_is_where_the_file_has_it(small: Path) -> None:
    road = scex.read_map(small / "wid.xodr")
    x = np.arange(1.0, 199.0)
    widens = 0.0042 * (x - 50) ** 2 - 5.6e-5 * (x - 50) ** 3
    inner = np.where(x < 50, 0.0, np.where(x < 100, widens, 3.5))
    lines = [lane.centreline for lane in road.lanes.values()]
    offsets = [np.abs(np.interp(x, *line.T, left=np.inf, right=np.inf) + inner + 1.75) for line in lines]
    assert np.min(offsets, axis=0).max() < 0.1


def test_lane_changes_of_fcd_cut_no_track(small: Path) -> None:
    driven_by_sumo(small / "fcd/n.sumocfg", "--step-length", "0.1")
    files = {"map_path": small / "fcd/n.net.xml", "track_paths": (small / "fcd/n.fcd.xml",)}
    loaded = scex.load_recording(scex.Recording(name="n", site="n", dataset="fcd", **files))
    assert loaded.vehicles == len(loaded.table.vehicles.labels) == 65
    assert "24 lane changes in one step: drawn over 3 s" in " ".join(loaded.findings)


@pytest.mark.parametrize(
    ("name", "time_s"),
    [
        *(("lefthand/left", 5.0), ("lefthand/right", 5.0), ("arrival/m", 5.0)),
        *(("export/g", 5.0), ("export/g36", 41.0), ("crossing/m", 3.0), ("crossing/f", 50.0)),
    ],
)
def test_sumo_s_drivers_are_where_sumo_alone_drives_them(name: str, time_s: float, small: Path) -> None:
    configuration = small / f"sumo/{name}.sumocfg"
    own = driven_by_sumo(configuration)
    scene, states = future_of_sumo(configuration, time_s)
    assert_there(scene, states, own[round(time_s + 2.9, 1)])  # a step of SUMO is named by its beginning


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_saved_state_goes_on_as_sumo_does_on_both_sides(side: str, small: Path) -> None:
    net = small / f"sumo/lefthand/{side}.net.xml"
    own = driven_by_sumo(net.with_name(f"{side}.sumocfg"))
    scene = scex.read_seed(net, tracks=net.with_name(f"{side}.state.xml"))  # saved at 5 s
    states = extrapolate(scene, models="sumo:own", futures=1, out=small / "out").states(0)
    assert_there(scene, states, own[7.9])


def assert_there(scene: scex.SeedScene, states: scex.States, own: dict[str, tuple[float, float]]) -> None:
    """Each vehicle that has not arrived ends within 30 cm of one of SUMO's own."""
    ahead, there = scene.length[:, None] / 2, np.array(list(own.values()))
    x, y = states.x + ahead * np.cos(states.heading), states.y + ahead * np.sin(states.heading)
    ends = np.stack([x[:, -1], y[:, -1]], axis=1)
    for end in ends[np.isfinite(ends).all(axis=1)]:
        assert np.linalg.norm(there - end, axis=1).min() < 0.3


def test_a_vehicle_whose_route_ends_leaves_the_future_there(small: Path) -> None:
    configuration = small / "sumo/arrival/m.sumocfg"
    last = max(time_s for time_s, vehicles in driven_by_sumo(configuration).items() if "ends" in vehicles)
    _, states = future_of_sumo(configuration, last - 1.0)
    gone = np.isnan(states.x).sum(axis=1)
    assert sorted(gone.tolist()) == [0, pytest.approx(19, abs=1)]
