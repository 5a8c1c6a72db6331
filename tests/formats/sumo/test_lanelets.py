from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.maps import read_map
from scex_sumo.formats.sumo.net import CHANGED
from scex_sumo.generators.synthetic import synthetic_seed
from scex_sumo.geometry.polylines import distances, length_of, samples
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.results.run import Run
from scex_sumo.road import Road
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from scex_sumo.scene import SeedScene
from tests.runs import extrapolate

EXAMPLES = ["motorway_merge", "roundabout", "urban_intersection"]
TAF_BW = "taf_bw/recorded_trackfiles"
# Maps of the shared data: recorded moments, or synthetic ones where there are no tracks.
SHARED: dict[str, tuple[str | None, float | None]] = {
    "interaction/maps/DR_DEU_Merging_MT.osm": (None, None),
    "taf_bw/maps/k733_2020-09-15.osm": (f"{TAF_BW}/k733_2020-09-15/vehicle_tracks_000.csv", 60.0),
    "mona/MONA-West/C-DEU_MONAWest-2_1_T-79.xml.gz": ("", None),
    "ngsim/USA_Peach-2_1_T-1.xml.gz": ("", None),
}
PATH_FOLLOWING = (
    "standard_driver",
    "risky_driver",
    "calibrated_driver",
    "constant_velocity",
    "emergency_brake",
)


def read_back(road: Road, folder: Path) -> Road:
    return read_map(convert(road, folder / f"{road.name}.net.xml").path)


@pytest.mark.parametrize("name", EXAMPLES)
def test_lanelets_come_back_from_a_net_with_their_ids_lines_widths_and_limits(
    name: str, tmp_path: Path
) -> None:
    road = read_map(example_path(name))
    back = read_back(road, tmp_path)
    assert back.lanes.keys() == road.vehicle_lanes.keys()
    for i, lane in road.vehicle_lanes.items():
        other = back.lanes[i]
        assert distances(samples(lane.centreline, 0.25)[1], other.centreline).max() < 1e-8
        # Where lanes fork at the map's border, the net's common lane has their first decimetre.
        assert abs(length_of(lane.centreline) - length_of(other.centreline)) < 0.1 + 1e-6
        assert set(other.successors) == set(lane.successors) and set(other.predecessors) == set(
            lane.predecessors
        )
        assert (other.left, other.right) == (lane.left, lane.right)
        assert other.width_m == pytest.approx(lane.width_m, abs=1e-8)
        assert other.speed_limit_mps == pytest.approx(lane.speed_limit_mps, abs=1e-8)


@pytest.mark.parametrize("name", SHARED)
def test_drivers_on_nets_of_real_maps_drive_as_on_the_maps(name: str, data: Path, tmp_path: Path) -> None:
    tracks, time_s = SHARED[name]
    if tracks is None:
        scene = synthetic_seed(data / name, vehicles=12)
    else:
        scene = read_seed(data / name, tracks=data / tracks if tracks else None, time=time_s)
    same_metrics(scene, tmp_path)


def same_metrics(scene: SeedScene, folder: Path) -> None:
    """Every metric of every future within 1e-6 for models that do not leave driving to SUMO.

    Without rules: a net has no drawn stop lines, and lights that a map does not time are timed in it.
    """
    assert scene.road is not None
    scenes = (scene, replace(scene, road=read_back(scene.road, folder)))
    one, other = (
        _metrics(
            extrapolate(s, futures=6, models=PATH_FOLLOWING, world="plain", rules=False, out=folder / str(k))
        )
        for k, s in enumerate(scenes)
    )
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_allclose(other[name], values, rtol=0, atol=1e-6, err_msg=name)


def _metrics(run: Run) -> dict[str, FloatArray]:
    return {c: run.metrics[c].to_numpy(zero_copy_only=False).astype(np.float64) for c in run.columns}


def test_sumo_s_own_drivers_see_the_very_net(tmp_path: Path) -> None:
    scene = read_seed(example_path("roundabout"))
    assert scene.road is not None
    back = replace(scene, road=read_back(scene.road, tmp_path))
    runs = [
        extrapolate(s, futures=2, models=["sumo:EIDM"], out=tmp_path / str(k))
        for k, s in enumerate((scene, back))
    ]
    for future in range(2):
        np.testing.assert_array_equal(runs[0].states(future).x, runs[1].states(future).x)
    assert runs[0].net.lanes.rows == runs[1].net.lanes.rows


def test_a_net_that_was_changed_since_is_read_as_it_is_now(tmp_path: Path) -> None:
    road = read_map(example_path("motorway_merge"))
    net = convert(road, tmp_path / "merge.net.xml")
    shape = re.compile('(<lane id="[^:"]*"[^>]* shape=")([-0-9.]+)')
    net.path.write_text(shape.sub(lambda m: f"{m[1]}{float(m[2]) - 5.0}", net.path.read_text(), count=1))
    back = read_map(net.path)
    assert CHANGED in back.notes and set(back.lanes) == set(range(1, len(back.lanes) + 1))
