"""What a simulation knows of its vehicles, against what SUMO itself does with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.driving.paths import seed_paths
from scex_sumo.behaviors.models.sumo import SumoDriver
from scex_sumo.results.info import digest
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene
from tests.formats.sumo.simulations import OVERTAKES, write_grid
from tests.runs import extrapolate
from tests.seeds import straight_seed

SMOOTH = '<lanechange.duration value="3"/>'  # as in futures
ROUTES = """<routes>
 <vType id="fast" sigma="0" accel="3.5" tau="0.8" speedFactor="1.3" speedDev="0"/>
 <vType id="slow" sigma="0" carFollowModel="IDM" speedFactor="0.7" speedDev="0" vClass="taxi"/>
 <flow id="f" type="fast" begin="0" end="90" period="4" from="A0A1" to="C1C2" departLane="best"/>
 <flow id="s" type="slow" begin="0" end="90" period="7" from="C0B0" to="A1A2"/>
 <trip id="stops" type="slow" depart="0" from="B0B1" to="B2C2">
  <stop lane="B0B1_1" endPos="40" duration="60"/>
 </trip>
</routes>"""
TIME_S = 24.0


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> SeedScene:
    grid = write_grid(tmp_path_factory.mktemp("grid"), routes=ROUTES, processing=SMOOTH)
    return read_seed(grid.config, time=TIME_S)


def index_of(scene: SeedScene, name: str) -> int:
    track = next(int(t) for t, known in scene.source["vehicles"].items() if known == name)
    return scene.track_ids.tolist().index(track)


def distances(scene: SeedScene, models: str, folder: Path) -> FloatArray:
    """Return (V,) of a future from the simulation 3 s later; nan for vehicles that have arrived."""
    run = extrapolate(scene, futures=1, models=models, reference="none", out=folder)
    last = run.tracks.slice(run.tracks.num_rows - 1)["frame_id"][0].as_py()
    rows = run.tracks.filter(np.asarray(run.tracks["frame_id"]) == last).sort_by("track_id")
    assert rows["track_id"].to_pylist() == sorted(scene.track_ids.tolist())
    assert scene.future is not None and scene.future_valid is not None
    there, order = scene.future[:, 29], np.argsort(scene.track_ids)
    off = np.hypot(rows["x"].to_numpy() - there.x[order], rows["y"].to_numpy() - there.y[order])
    return np.where(scene.future_valid[order, 29], off, np.nan)


def test_futures_of_its_own_drivers_are_what_sumo_does(scene: SeedScene, tmp_path: Path) -> None:
    off = distances(scene, "sumo:own", tmp_path / "own")
    assert np.isfinite(off).sum() > 10
    assert np.nanmedian(off) < 0.1 and np.nanmax(off) < 2.0


@pytest.mark.parametrize(("time_s", "most_m"), [(9.0, 0.5), (11.0, 0.1)])
def test_a_lane_change_goes_on_as_it_began(tmp_path: Path, time_s: float, most_m: float) -> None:
    grid = write_grid(tmp_path, routes=OVERTAKES, processing=SMOOTH)
    scene = read_seed(grid.config, time=time_s)
    fast = scene.intention(index_of(scene, "fast"))
    assert fast is not None and fast.change_mps == pytest.approx(3.2 / 3.0)  # a lane in 3 s
    # From 8.5 s to 11.5 s; SUMO's lane is the new one from 10.1 s on.
    assert np.nanmax(distances(scene, "sumo:own", tmp_path / "own")) < most_m


def test_a_stop_is_kept_though_a_lane_change_of_one_step_is_drawn(tmp_path: Path) -> None:
    """One is not where SUMO has saved it, so that no vehicle goes on from that state."""
    stops = '<trip id="stops" type="slow" depart="0" from="B0B1" to="B2C2">'
    stops += '<stop lane="B0B1_1" endPos="20" duration="60"/></trip><trip'
    grid = write_grid(tmp_path, routes=OVERTAKES.replace("<trip", stops, 1), step_s=1.0)
    scene = read_seed(grid.config, time=10.0)
    stands = index_of(scene, "stops")
    assert scene.now.speed[stands] < 0.1
    row = sorted(scene.track_ids.tolist()).index(scene.track_ids[stands])
    assert distances(scene, "sumo:own", tmp_path / "own")[row] < 0.1


def test_a_scene_knows_types_speeds_routes_and_stops(scene: SeedScene) -> None:
    fast, slow, stops = (scene.intention(index_of(scene, name)) for name in ("f.2", "s.1", "stops"))
    assert fast is not None and slow is not None and stops is not None
    assert (fast.model, fast.speed_factor, fast.vehicle_class) == ("Krauss", 1.3, "passenger")
    assert (slow.model, slow.speed_factor, slow.vehicle_class) == ("IDM", 0.7, "taxi")
    assert {key: float(fast.parameters[key]) for key in ("accel", "tau")} == {"accel": 3.5, "tau": 0.8}
    assert fast.edges[-1] == "C1C2" and slow.edges[-1] == "A1A2"
    (stop,) = stops.stops
    assert (stop.lane, stop.end_m) == ("B0B1_1", 40.0) and 0 < stop.duration_s < 60
    assert digest(scene) != digest(scene.reordered(range(scene.vehicles)[::-1], name="r"))


def test_a_driver_has_the_parameters_of_the_vehicle_then_its_own(scene: SeedScene) -> None:
    fast = index_of(scene, "f.2")
    assert SumoDriver("own").driving(scene, fast)[0] == "Krauss"
    model, parameters = SumoDriver("EIDM", {"tau": "2"}).driving(scene, fast)
    assert (model, parameters["tau"], float(parameters["accel"])) == ("EIDM", "2", 3.5)
    with pytest.raises(UsageError, match="not of a SUMO simulation; name a model, one of Krauss"):
        SumoDriver("own").driving(straight_seed(), 0)
    assert SumoDriver("IDM").driving(straight_seed(), 0) == ("IDM", {})


@pytest.mark.parametrize("path", ["straight", "random"])
def test_our_drivers_take_the_routes_of_the_simulation_at_its_speeds(scene: SeedScene, path: str) -> None:
    assert scene.road is not None
    vehicles, paths = np.arange(scene.vehicles), seed_paths(scene, scene.road)
    rows = paths.choose(path, vehicles, np.linspace(0, 0.999, scene.vehicles))  # type: ignore[arg-type]
    for vehicle, row in enumerate(rows.tolist()):
        intention = scene.intention(vehicle)
        assert intention is not None
        on_route = [lane for lane in paths.lanes[row] if lane in intention.lanes]
        assert on_route == list(paths.lanes[row][: len(on_route)]) and on_route
        limit = scene.road.lanes[paths.lanes[row][0]].speed_limit_mps
        assert paths.speed_limit[row, 40] == pytest.approx(limit * intention.speed_factor)
    turning = sum(len({*paths.lanes[row]}) > 2 for row in rows.tolist())
    assert turning > 3
