"""The side of traffic is that of the drawn lanes, else of the country, else of the place."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.lanelet.tags import drives_left_at
from scex_sumo.converters.maps import read_map
from scex_sumo.roads.mirror import mirrored_road
from scex_sumo.roads.side import UNKNOWN, drives_on_left, side_of
from scex_sumo.scenarios import example_path
from tests.converters.maps import ROAD, straight, write_map
from tests.converters.sumo_roads import lane, road

STREETS = """<osm version="0.6">
 <node id="1" lat="{lat}" lon="{lon}"/><node id="2" lat="{lat}" lon="{lon}2"/>
 <way id="9"><nd ref="1"/><nd ref="2"/><tag k="highway" v="residential"/></way>
</osm>"""


@pytest.mark.parametrize("name", ["roundabout", "urban_intersection"])
def test_oncoming_lanes_tell_the_side(name: str) -> None:
    drawn = read_map(example_path(name))
    assert drives_on_left(drawn.lanes) is False
    assert drives_on_left(mirrored_road(drawn).lanes) is True


def test_without_oncoming_lanes_it_is_told_or_noted_where_it_matters() -> None:
    alone = road([lane(1, [(0, 0), (90, 0)])]).lanes
    beside = road([lane(1, [(0, 0), (90, 0)], left=2), lane(2, [(0, 3.5), (90, 3.5)], right=1)]).lanes
    assert drives_on_left(alone) is None
    assert side_of(beside, None, True) == (True, ())
    assert side_of(beside, None) == (False, (UNKNOWN,))
    assert side_of(alone, None) == (False, ())


@pytest.mark.parametrize(("region", "left"), [("jp", True), ("gb", True), ("au_nsw", True), ("de", False)])
def test_a_lanelet2_map_without_oncoming_lanes_has_the_side_of_its_region(
    region: str, left: bool, tmp_path: Path
) -> None:
    lanelet = straight(1, 0, 90, tags={**ROAD, "region": region})
    assert read_road(write_map(tmp_path / "a.osm", [lanelet])).left_hand is left


@pytest.mark.parametrize(
    ("place", "left"),
    [
        ((51.50, -0.12), True),  # London
        ((35.68, 139.7), True),  # Tokyo
        ((-33.87, 151.2), True),  # Sydney
        ((50.95, 1.85), False),  # Calais
        ((35.10, 129.04), False),  # Busan
        ((49.0, 8.4), False),  # Karlsruhe
        ((0.0, 0.0), None),  # nowhere
    ],
)
def test_places_have_the_side_of_their_country(place: tuple[float, float], left: bool | None) -> None:
    assert drives_left_at(place) is left


@pytest.mark.parametrize(("lat", "lon", "left"), [("51.5", "-0.12", True), ("49.0", "8.4", False)])
def test_open_street_map_has_the_side_of_its_place(lat: str, lon: str, left: bool, tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text(STREETS.format(lat=lat, lon=lon))
    town = read_map(tmp_path / "town.osm")
    assert town.left_hand is left is drives_on_left(town.lanes)
