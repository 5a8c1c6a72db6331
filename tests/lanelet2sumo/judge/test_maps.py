"""Maps that are awkward on purpose are converted faithfully, and SUMO's cars drive on them."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.lanelet2sumo.convert import convert
from tests.converters.maps import write_map
from tests.lanelet2sumo.judge.adversarial import MAPS
from tests.lanelet2sumo.judge.driving import drive_net
from tests.lanelet2sumo.judge.loading import check_net

# What no right of way can prevent: cars that meet head-on in one lane, and cars that appear in the middle of
# a crossing, or where the car ahead has not quite left the short entry that several lanelets share.
HEAD_ON = {"both_ways", "same_ground_both_ways"}
APPEARING = {"border_fork"}
ABOVE_EACH_OTHER = {"bridge"}  # footprints are flat; cars on two levels cover each other


@pytest.mark.parametrize("name", sorted(MAPS))
def test_an_awkward_map_is_converted_faithfully(name: str, tmp_path: Path) -> None:
    drawing = MAPS[name]()
    path = tmp_path / f"{name}.osm"
    road = read_road(write_map(path, drawing.lanelets, lines=drawing.lines, relations=drawing.relations))
    net = convert(road, tmp_path / f"{name}.net.xml")
    assert check_net(net.path, road, net.lanes).problems() == []
    driving = drive_net(net.path, vehicles=60)
    if name in HEAD_ON | APPEARING | ABOVE_EACH_OTHER:
        assert (driving["arrived"], driving["teleports"]) == (driving["vehicles"], 0)
    else:
        assert driving.problems() == []
