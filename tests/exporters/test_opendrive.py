from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.opendrive.file import opendrive
from scex_sumo.geometry.polylines import arc_lengths, distances, samples
from scex_sumo.road import Road
from scex_sumo.scenarios import example_path
from tests.exporters.opendrive_reader import OpenDrive, reference

SHARED = (
    "interaction/maps/DR_DEU_Merging_MT.osm",
    "interaction/maps/DR_USA_Intersection_GL.osm",
    "taf_bw/maps/k733_2020-09-15.osm",
    "ngsim/USA_Lanker-2_10_T-1.xml.gz",
)


def off(road: Road, file: OpenDrive) -> FloatArray:
    """Distances between the borders of each lane and the file's, from either side, m."""
    found = []
    for i, lane in road.lanes.items():
        for side, border in enumerate((lane.left_bound, lane.right_bound)):
            parts = [part[side] for part in file.borders(i)]
            found.append(distances(np.vstack(parts), border))
            there = samples(border, 0.25)[1]
            found.append(np.min([distances(there, part) for part in parts], axis=0))
    return np.concatenate(found)


def check(road: Road) -> None:
    file = OpenDrive(opendrive(road).text)
    error = off(road, file)
    assert np.percentile(error, 95) < 0.05 and error.max() < 0.12  # as docs/handover.md promises
    assert file.successors() == {
        (i, j) for i, x in road.lanes.items() for j in x.successors if j in road.lanes
    }
    for lane in file.lanes:
        assert lane.speed == pytest.approx(road.lanes[lane.lane].speed_limit_mps, abs=1e-3)


@pytest.mark.parametrize("name", ["roundabout", "urban_intersection"])
def test_borders_and_links_are_those_of_the_example_maps(name: str) -> None:
    check(read_map(example_path(name)))


@pytest.mark.parametrize("name", SHARED)
def test_borders_and_links_are_those_of_real_maps(name: str, data: Path) -> None:
    path = data / name
    if not path.exists():
        pytest.skip(f"no {name} among the real maps")
    check(read_map(path))


def test_reference_lines_have_no_gap_and_the_lengths_they_say() -> None:
    file = OpenDrive(opendrive(read_map(example_path("roundabout"))).text)
    for road in file.roads.values():
        pieces = road.findall("planView/geometry")
        for piece, after in pairwise(pieces):
            start, size = float(piece.get("s", "nan")), float(piece.get("length", "nan"))
            line, _ = reference(road, start + np.linspace(0.0, size - 1e-7, 200))
            assert arc_lengths(line)[-1] == pytest.approx(size, abs=1e-3)
            place = np.array([float(after.get(axis, "nan")) for axis in "xy"])
            assert np.hypot(*(line[-1] - place)) < 1e-4


def test_crosswalks_stop_lines_and_priorities_are_there() -> None:
    road = read_map(example_path("urban_intersection"))
    root = ET.fromstring(opendrive(road).text)
    walks = {one.area_id: one.outline for one in road.areas if one.kind == "crosswalk"}
    assert {int(e.get("id", "0")) for e in root.iter("object")} == set(walks)
    for e in root.iter("object"):
        corners = [(float(c.get("u", "nan")), float(c.get("v", "nan"))) for c in e.iter("cornerLocal")]
        outline = shapely.Polygon(walks[int(e.get("id", "0"))])
        assert shapely.Polygon(corners).area == pytest.approx(outline.area, rel=1e-3)
    types = {e.get("type") for e in root.iter("signal")}
    assert "294" in types
    driven = {e.get("id"): e.get("junction") for e in root.iter("road")}
    for junction in root.iter("junction"):
        for e in junction.iter("priority"):
            assert {driven[e.get("high")], driven[e.get("low")]} == {junction.get("id")}
    assert list(root.iter("priority"))


def test_pyxodr_reads_every_lane_of_a_map(tmp_path: Path) -> None:
    network = pytest.importorskip("pyxodr.road_objects.network")
    road = read_map(example_path("urban_intersection"))
    file = tmp_path / "map.xodr"
    file.write_text(opendrive(road).text)
    roads = network.RoadNetwork(xodr_file_path=file, resolution=0.5).get_roads()
    assert sum(len(section.lanes) for one in roads for section in one.lane_sections) == len(road.lanes)
