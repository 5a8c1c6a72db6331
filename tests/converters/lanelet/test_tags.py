"""Speed limits in every spelling that maps use."""

from __future__ import annotations

from pathlib import Path

import pytest

from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.lanelet.tags import speed_mps
from tests.converters.maps import Line, rule, straight, write_map

KMH = 1 / 3.6


@pytest.mark.parametrize(
    ("text", "kmh"),
    [
        ("50", 50),
        ("50kmh", 50),
        ("50 km/h", 50),
        ("30 kmh", 30),
        ("30.5", 30.5),
        ("15mph", 24.14016),  # 15 x 1.609344
        ("25 mph", 40.2336),
        ("10 m/s", 36),
        ("10mps", 36),
        ("DE:urban", 50),
        ("DE:rural", 100),
        ("RU:urban", 60),
        ("GB:motorway", 112.65408),  # 70 x 1.609344
        ("de274-30", 30),
        ("de274-60", 60),
        ("de274-56", 60),  # the sign's number before 2017
        ("de274.1", 30),
        ("de274.1-20", 20),
        ("274.1", 30),
        ("274-60", 60),
        ("de310", 50),
        ("none", 130),
    ],
)
def test_a_limit_is_read_in_every_spelling(text: str, kmh: float) -> None:
    assert speed_mps(text) == pytest.approx(kmh * KMH, rel=1e-9)


@pytest.mark.parametrize(
    ("tags", "kmh"),
    [
        ({}, 50),
        ({"location": "urban"}, 50),
        ({"location": "nonurban"}, 100),
        ({"location": "nonurban", "subtype": "highway"}, 130),
        ({"subtype": "play_street"}, 7),
        ({"subtype": "walkway"}, 5),
        ({"subtype": "bicycle_lane"}, 20),
        ({"maxspeed": "60"}, 60),
        ({"speed_limit": "30 mph"}, 48.28032),
        ({"speed_limit": "30", "maxspeed": "60"}, 30),
        ({"speed_limit:vehicle": "40"}, 40),
        ({"maxspeed": "signals", "location": "nonurban"}, 100),
    ],
)
def test_a_lane_has_its_tagged_limit_or_the_default(tmp_path: Path, tags: dict[str, str], kmh: float) -> None:
    drawn = write_map(tmp_path / "drawn.osm", [straight(1, 0, 50, tags=tags)])
    road = read_road(drawn)
    assert road.lanes[1].speed_limit_mps == pytest.approx(kmh * KMH, rel=1e-9)
    unclear = tags.get("maxspeed") == "signals"
    assert bool(road.notes) == unclear


def test_a_limit_is_read_from_the_sign(tmp_path: Path) -> None:
    sign = Line(8, [(0, 4), (0, 5)], {"type": "traffic_sign", "subtype": "de274-30"})
    element = rule(90, "speed_limit", [("refers", 8)])
    drawn = write_map(
        tmp_path / "drawn.osm", [straight(1, 0, 50, rules=[90])], lines=[sign], relations=[element]
    )
    assert read_road(drawn).lanes[1].speed_limit_mps == pytest.approx(30 * KMH, rel=1e-9)


def test_a_sign_that_says_no_limit_leaves_the_default_and_is_noted(tmp_path: Path) -> None:
    element = rule(90, "speed_limit", sign_type="usR2-1")
    drawn = write_map(tmp_path / "drawn.osm", [straight(1, 0, 50, rules=[90])], relations=[element])
    road = read_road(drawn)
    assert road.lanes[1].speed_limit_mps == pytest.approx(50 * KMH, rel=1e-9)
    assert road.notes == ("speed limits not understood, Germany's default taken: 1",)
