from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.maps import read_map
from scex_sumo.converters.sumo.imported import is_open_street_map
from scex_sumo.errors import MapError
from scex_sumo.exporters.opendrive.file import opendrive_text
from scex_sumo.geometry.polylines import distances, samples
from scex_sumo.scenarios import example_path

STREETS = """<osm version="0.6">
 <node id="1" lat="49.0" lon="8.4"/><node id="2" lat="49.0" lon="8.402"/>
 <node id="3" lat="49.001" lon="8.402"/>
 <way id="9"><nd ref="1"/><nd ref="2"/><nd ref="3"/><tag k="highway" v="residential"/></way>
</osm>"""


def test_opendrive_of_this_project_comes_back_within_decimetres(tmp_path: Path) -> None:
    road = read_map(example_path("motorway_merge"))
    (tmp_path / "merge.xodr").write_text(opendrive_text(road))
    back = read_map(tmp_path / "merge.xodr")
    lines = [lane.centreline for lane in back.vehicle_lanes.values()]
    for lane in road.vehicle_lanes.values():
        points = samples(lane.centreline, 1.0)[1]
        near = np.min([distances(points, line) for line in lines], axis=0)
        assert np.median(near) < 0.1  # netconvert gives lanes one width, so borders and middles shift
    assert back.net is not None and "read by way of netconvert" in back.notes[0]


def test_open_street_map_is_told_from_lanelet2_and_becomes_a_net(tmp_path: Path) -> None:
    file = tmp_path / "town.osm"
    file.write_text(STREETS)
    assert is_open_street_map(file) and not is_open_street_map(example_path("roundabout"))
    road = read_map(file)
    assert road.name == "town" and len(road.vehicle_lanes) >= 2


def test_what_netconvert_refuses_is_said(tmp_path: Path) -> None:
    file = tmp_path / "bad.xodr"
    file.write_text("<OpenDRIVE>")
    with pytest.raises(MapError, match=r"bad.xodr: netconvert cannot read it"):
        read_map(file)
