"""A road of the user's is checked where it is converted: one line names the lane."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import MapError
from tests.converters.sumo_roads import lane, road


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"successors": (7,)}, "lane 1: successors names 7, which is no lane of the map"),
        ({"conflicts": (9,)}, "lane 1: conflicts names 9, which is no lane of the map"),
        ({"adjacent_left": 5}, "lane 1: adjacent_left names 5, which is no lane of the map"),
        ({"speed_limit_mps": 0.0}, "lane 1: speed_limit_mps is 0.0; needs more than 0"),
        ({"centreline": np.zeros((2, 3))}, "lane 1: centreline is no line of 2 or more finite points"),
    ],
)
def test_what_no_road_can_have_is_named_before_it_is_converted(
    changes: dict[str, Any], says: str, tmp_path: Path
) -> None:
    good = road([lane(1, [(0, 0), (80, 0)], to=(2,)), lane(2, [(80, 0), (180, 0)])])
    bad = replace(good, lanes={**good.lanes, 1: replace(good.lanes[1], **changes)})
    with pytest.raises(MapError, match=f"^road drawn: {says}"):
        scex.convert(bad, tmp_path / "n.net.xml")
    scene = scex.read_seed(scex.example_path("roundabout"))
    with pytest.raises(MapError, match=f"^road drawn: {says}"):
        scex.extrapolate(replace(scene, road=bad), models="constant_velocity", futures=1, out=tmp_path / "o")
    assert not (tmp_path / "o" / "futures").exists()
