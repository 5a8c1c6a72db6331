"""Nets know where they lie on Earth, as SUMO reads it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.projection import georeference
from scex_sumo.lanelet2sumo.convert import convert
from tests.command import script
from tests.converters.sumo_roads import NetFile, lane, road
from tests.lanelet2sumo.judge.report import check_net

CONVERT = """
import sys, libsumo
libsumo.start(["sumo", "-n", sys.argv[1], "--no-step-log", "--no-warnings"])
print(*libsumo.simulation.convertGeo(0.0, 0.0))
"""
PLACES = {
    "Karlsruhe": (49.0053, 8.4374),
    "Los Angeles": (34.1381, -118.3622),
    "Sydney": (-33.8688, 151.2093),
    "Bergen, in a zone wider than 6 degrees": (60.3913, 5.3221),
    "Longyearbyen, in a zone of Svalbard": (78.2232, 15.6267),
}


@pytest.mark.parametrize("name", PLACES)
def test_sumo_finds_the_origin_of_a_net_on_earth(name: str, tmp_path: Path) -> None:
    place = PLACES[name]
    drawn = replace(road([lane(1, [(-5, 0), (80, 0)])]), origin=place, georeference=georeference(place))
    net = convert(drawn, tmp_path / "place.net.xml")
    lon, lat = map(float, script(CONVERT, net.path).stdout.split())
    assert (lat, lon) == pytest.approx(place, abs=1e-8)  # a millimetre
    assert check_net(net.path, drawn, net.lanes).problems() == []


def test_a_map_drawn_around_0_0_lies_nowhere(tmp_path: Path) -> None:
    convert(road([lane(1, [(0, 0), (80, 0)])]), tmp_path / "drawn.net.xml")
    location = NetFile(tmp_path / "drawn.net.xml").root.find("location")
    assert location is not None
    assert (location.get("projParameter"), location.get("netOffset")) == ("!", "0.00,0.00")
