"""The reader of SUMO nets takes what SUMO writes, and names what a damaged net misses."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.lanelet2sumo.judge.report import check_net
from scex_sumo.lanelet2sumo.reader import read_net
from scex_sumo.lanelet2sumo.road_lines import SURFACE, road_lines
from scex_sumo.views.fcd import LaneFinder
from tests.converters.plain_net import Table, crossing, write_net

EAST = '<lane id="east_0" index="0" speed="13.89" length="45.00" width="3.50" shape="15.00,0.00 60.00,0.00"/>'


def test_points_with_and_without_heights_may_be_mixed(tmp_path: Path) -> None:
    shape = 'shape="15.00,0.00,3.50 30.00,0.00 60.00,0.00,4.00"'
    net = write_net(tmp_path, ('shape="15.00,0.00 60.00,0.00"', shape))
    east = read_net(net).lanes["east_0"]
    np.testing.assert_array_equal(east.shape, [[15, 0], [30, 0], [60, 0]])
    assert LaneFinder(net).find(*np.array([[40.0], [0.0], [0.0]]), np.array([True]))[0] == ["east_0"]
    assert check_net(net, crossing(), Table()).problems() == []


def test_a_lane_without_width_is_as_wide_as_sumo_makes_it_and_is_drawn(tmp_path: Path) -> None:
    net = write_net(tmp_path, (EAST, EAST.replace(' width="3.50"', "")))
    assert read_net(net).lanes["east_0"].width_m == 3.2
    surfaces = [line for line in road_lines(net, (-99, 99, -99, 99)) if line.kind == SURFACE]
    assert len(surfaces) == 8 and 3.2 in [line.width_m for line in surfaces]


def test_a_gzipped_net_is_read(tmp_path: Path) -> None:
    net = write_net(tmp_path)
    packed = tmp_path / "packed.net.xml.gz"
    packed.write_bytes(gzip.compress(net.read_bytes()))
    assert read_net(packed).lanes.keys() == read_net(net).lanes.keys()


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ((' index="0"', ""), "has no index"),
        ((' shape="15.00,0.00 60.00,0.00"', ""), "has no shape"),
        (('shape="15.00,0.00 60.00,0.00"', 'shape=""'), "cannot be read (its shape has no points"),
        (('length="45.00"', 'length="long"'), "cannot be read (could not convert"),
    ],
)
def test_a_lane_that_misses_something_is_named(edit: tuple[str, str], words: str, tmp_path: Path) -> None:
    net = write_net(tmp_path, (EAST, EAST.replace(*edit)))
    with pytest.raises(MapError) as error:
        check_net(net, crossing(), Table())
    assert f"<lane id='east_0'> {words}" in str(error.value)


@pytest.mark.parametrize(
    "edit",
    [
        ('<request index="2" response="011" foes="011" cont="0"/>', ""),
        ('<request index="2" response="011" foes="011"', '<request index="2" response="01" foes="1"'),
        ('<request index="2" response="011" foes="011"', '<request index="2" response="01101" foes="01101"'),
        ('<request index="2" response="011" foes="011"', '<request index="2"'),
    ],
)
def test_requests_of_another_length_are_figures_not_errors(edit: tuple[str, str], tmp_path: Path) -> None:
    report = check_net(write_net(tmp_path, edit), crossing(), Table())
    assert report["sumo_warnings"] or report["missing_foes"] or report["wrong_priority"]
