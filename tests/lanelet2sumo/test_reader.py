"""The reader of SUMO nets takes what SUMO writes, and names what a damaged net misses."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.lanelet2sumo.reader import read_net
from tests.converters.plain_net import Table, crossing, write_net
from tests.lanelet2sumo.judge.report import check_net

EAST = '<lane id="east_0" index="0" speed="13.89" length="45.00" width="3.50" shape="15.00,0.00 60.00,0.00"/>'


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
