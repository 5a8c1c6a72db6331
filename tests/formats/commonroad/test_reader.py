"""CommonRoad maps: what their lanelets, signs and lights become."""

from __future__ import annotations

import builtins
import gzip
import logging
import random
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from scex_sumo.base.errors import MapError, MissingExtraError
from scex_sumo.converters.maps import read_map
from scex_sumo.formats.commonroad.reader import read_commonroad_road
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from tests.formats.commonroad.commonroad_maps import (
    Lanelet,
    Sign,
    StopLine,
    scenario,
    straight,
    write_scenario,
)
from tests.lanelet2sumo.judge.driving import judged
from tests.lanelet2sumo.judge.report import check_net

SITES = ("MONA-Merge", "MONA-West")


def read(folder: Path, lanelets: list[Lanelet], **rest: Any) -> Road:
    return read_commonroad_road(write_scenario(folder / "map.xml", lanelets, **rest))


def side_by_side(left_marking: str, right_marking: str) -> list[Lanelet]:
    """Lanelet 2 lies to the left of lanelet 1; the line between them as either of them has it."""
    return [
        straight(1, 0, 0, 50, left_of=(2, "same"), left_marking=right_marking),
        straight(2, 0, 3, 50, right_of=(1, "same"), right_marking=left_marking),
    ]


def crossing(**east: Any) -> list[Lanelet]:
    """Lanelet 1 runs east, lanelet 2 north; they cross at (50, 0)."""
    north = Lanelet(2, left=[(48.5, -50), (48.5, 50)], right=[(51.5, -50), (51.5, 50)])
    return [straight(1, 0, 0, 100, **east), north]


def test_bounds_with_unequally_many_points_have_their_middle_by_length(tmp_path: Path) -> None:
    lane = read(tmp_path, [Lanelet(5, [(0, 9), (10, 9), (50, 9)], [(0, 6), (50, 6)])]).lanes[5]
    assert_array_equal(lane.centreline, [(0, 7.5), (10, 7.5), (50, 7.5)])
    assert len(lane.right_bound) == 2


def test_a_lanelet_keeps_its_bounds_and_its_centre_lies_between_them(tmp_path: Path) -> None:
    left, right = [(0, 4), (10, 4), (30, 8)], [(0, 0), (12, 0), (32, 4)]
    lane = read(tmp_path, [Lanelet(7, left, right)]).lanes[7]
    assert_array_equal(lane.left_bound, left)
    assert_array_equal(lane.right_bound, right)
    assert_array_equal(lane.centreline, [(0, 2), (11, 2), (31, 6)])
    assert (lane.kind, lane.subtype, lane.location) == ("vehicle", "road", "urban")


def test_successors_are_known_to_both_lanelets_even_if_the_file_says_it_once(tmp_path: Path) -> None:
    road = read(tmp_path, [straight(1, 0, 0, 50, successors=[2]), straight(2, 50, 0, 50)])
    assert road.lanes[1].successors == (2,)
    assert road.lanes[2].predecessors == (1,)
    assert any("only one of the two lanelets knows, kept: 1-2" in note for note in road.notes)


@pytest.mark.parametrize(
    ("marking", "to_left", "to_right"),
    [
        ("", True, True),
        ("dashed", True, True),
        ("no_marking", True, True),
        ("solid", False, False),
        ("broad_solid", False, False),
        ("curb", False, False),
        ("dashed_solid", False, True),  # dashed for those on its left: they may cross to the right
        ("solid_dashed", True, False),
    ],
)
def test_lanes_are_changed_where_the_line_between_them_allows_it(
    marking: str, to_left: bool, to_right: bool, tmp_path: Path
) -> None:
    lanes = read(tmp_path, side_by_side(marking, marking)).lanes
    assert lanes[1].left == (2 if to_left else None)
    assert lanes[2].right == (1 if to_right else None)
    assert (lanes[1].adjacent_left, lanes[2].adjacent_right) == (2, 1)
    assert (lanes[1].right, lanes[2].left) == (None, None)


@pytest.mark.parametrize(
    ("types", "users", "kind"),
    [
        (["urban"], [], "vehicle"),
        (["unknown"], [], "vehicle"),
        (["highway", "mainCarriageWay"], ["car", "truck"], "vehicle"),
        (["sidewalk"], [], "pedestrian"),
        (["crosswalk"], ["pedestrian", "bicycle"], "pedestrian"),
        (["urban", "bicycleLane"], ["bicycle"], "bicycle"),
        (["busLane"], ["bus", "taxi"], "bus"),
        (["busLane"], ["car", "bus"], "vehicle"),
        (["urban"], ["bicycle"], "bicycle"),
        (["highway", "shoulder"], ["vehicle"], "other"),
        (["restricted_area"], [], "other"),
        (["urban"], ["train"], "other"),
    ],
)
def test_types_and_users_decide_who_drives_there(
    types: list[str], users: list[str], kind: str, tmp_path: Path
) -> None:
    lanelets = [straight(1, 0, 0, 50, types=types, one_way=users), straight(2, 0, 20, 50)]
    road = read(tmp_path, lanelets)
    assert road.lanes[1].kind == kind
    assert [area.area_id for area in road.areas] == ([] if kind == "vehicle" else [1])


def test_a_lanelet_that_cars_use_both_ways_is_two_lanes(tmp_path: Path) -> None:
    """1 -> 2 <-> 3: the way back from 3 over 2 ends where 4 leads away beside 1."""
    both = {"one_way": [], "both_ways": ["vehicle"]}
    lanelets = [
        straight(1, 0, 0, 50, successors=[2]),
        straight(2, 50, 0, 50, predecessors=[1], successors=[3], **both),
        straight(3, 100, 0, 50, predecessors=[2], **both),
        Lanelet(4, left=[(50, -1.5), (0, -9)], right=[(50, 1.5), (0, -6)]),
    ]
    road = read(tmp_path, lanelets)
    lanes = road.lanes
    assert {i: lane.reverse_of for i, lane in lanes.items() if lane.reverse_of} == {5: 2, 6: 3}
    assert_array_equal(lanes[5].centreline, [(100, 0), (50, 0)])
    assert_array_equal(lanes[5].left_bound, [(100, -1.5), (50, -1.5)])
    assert (lanes[6].successors, lanes[5].predecessors) == ((5,), (6,))
    assert (lanes[5].successors, lanes[4].predecessors) == ((4,), (5,))
    assert (lanes[1].successors, lanes[2].successors, lanes[3].successors) == ((2,), (3,), ())
    assert lanes[2].conflicts == lanes[5].conflicts == ()
    net = convert(road, tmp_path / "both.net.xml")
    assert check_net(net.path, road, net.lanes).problems() == []


def test_a_lane_that_ends_where_a_two_way_lanelet_ends_leads_onto_its_opposite_lane(tmp_path: Path) -> None:
    back = Lanelet(2, left=[(100, -1.5), (50, -1.5)], right=[(100, 1.5), (50, 1.5)])
    lanes = read(tmp_path, [straight(1, 0, 0, 50, one_way=[], both_ways=["vehicle"]), back]).lanes
    assert lanes[3].reverse_of == 1
    assert (lanes[2].successors, lanes[3].predecessors) == ((3,), (2,))
    assert (lanes[1].successors, lanes[2].predecessors) == ((), ())


def test_opposite_lanes_follow_each_other_as_their_lanelets_do_also_across_a_gap(tmp_path: Path) -> None:
    both = {"one_way": [], "both_ways": ["vehicle"]}
    lanelets = [
        straight(1, 0, 0, 50, successors=[2], **both),
        straight(2, 50.8, 0, 50, predecessors=[1], **both),
    ]
    road = read(tmp_path, lanelets)
    assert (road.lanes[4].successors, road.lanes[3].predecessors) == ((3,), (4,))
    assert not [note for note in road.notes if "without successors in the map" in note]


def test_the_largest_id_has_an_opposite_lane_and_greater_ones_are_left_out(tmp_path: Path) -> None:
    both = {"one_way": [], "both_ways": ["vehicle"]}
    greater = [straight(2**53 - 1, 0, 30, 50, **both)]
    road = read(tmp_path, [straight(2**52 - 1, 0, 0, 50, **both), *greater])
    assert {i: lane.reverse_of for i, lane in road.lanes.items()} == {2**52 - 1: None, 2**52: 2**52 - 1}
    assert "lanelets left out, their id is no positive number: 9007199254740991" in road.notes


@pytest.mark.parametrize("value", ["fast", "-3", "0", "nan", "120"])
def test_a_limit_that_is_none_in_metres_per_second_is_left_out_and_noted(value: str, tmp_path: Path) -> None:
    road = read(tmp_path, [straight(1, 0, 0, 50, signs=[90])], signs=[Sign(90, "274", [value])])
    assert_allclose(road.lanes[1].speed_limit_mps * 3.6, 50)
    assert "speed limits that are none in m/s, left out: 1" in road.notes


def test_a_bridge_is_no_conflict(tmp_path: Path) -> None:
    def level(lanelet: Lanelet, z: float) -> Lanelet:
        left, right = ([(*p, z) for p in side] for side in (lanelet.left, lanelet.right))
        return Lanelet(lanelet.lanelet_id, left, right)

    below, above = crossing()
    assert read(tmp_path, [level(below, 0.0), level(above, 5.0)]).lanes[1].conflicts == ()
    assert read(tmp_path, [level(below, 0.0), level(above, 1.0)]).lanes[1].conflicts == (2,)


@pytest.mark.parametrize(
    ("country", "written", "kind"),
    [
        ("DEU", "205", "yield"),
        ("DEU", "206", "stop"),
        ("ZAM", "206", "stop"),
        ("USA", "R1-1", "stop"),
        ("USA", "R1-3", "all_way_stop"),
        ("ESP", "r1", "yield"),
    ],
)
def test_signs_are_regulations_in_every_country(
    country: str, written: str, kind: str, tmp_path: Path
) -> None:
    east = {"signs": [90], "stop_line": StopLine(points=[(45, 2), (45, -2)], signs=[90])}
    road = read(tmp_path, crossing(**east), signs=[Sign(90, written)], benchmark=f"{country}_Test-1_1_T-1")
    (rule,) = road.regulations
    assert (rule.kind, rule.lanes, rule.yielding, rule.signs) == (kind, (1,), (1,), (written,))
    assert_array_equal(rule.stop_lines[0], [(45, 2), (45, -2)])
    assert [line.kind for line in road.markings] == ["stop_line"]


def test_who_has_a_priority_sign_goes_before_who_has_none(tmp_path: Path) -> None:
    road = read(tmp_path, crossing(signs=[90]), signs=[Sign(90, "306")], intersections={100: [[1], [2]]})
    (rule,) = road.regulations
    assert (rule.element_id, rule.kind) == (100, "right_of_way")
    assert (rule.priority, rule.yielding) == ((1,), (2,))


def test_the_origin_is_the_files_place_unless_one_is_given(tmp_path: Path) -> None:
    path = write_scenario(tmp_path / "map.xml", [straight(1, 0, 0, 50)], place=(48.2, 11.6))
    assert read_commonroad_road(path).origin == (48.2, 11.6)
    moved = read_commonroad_road(path, origin=(49.0, 8.4))
    assert moved.origin == (49.0, 8.4)
    assert_array_equal(moved.lanes[1].centreline, [(0, 0), (50, 0)])
    write_scenario(path, [straight(1, 0, 0, 50)], place=(999, 999))
    assert read_commonroad_road(path).origin == (0.0, 0.0)


def test_a_crossing_with_a_yield_sign_becomes_a_net_that_is_faithful(tmp_path: Path) -> None:
    east = [
        straight(1, -60, 0, 100, successors=[3], signs=[90]),
        straight(3, 40, 0, 20, predecessors=[1], successors=[4]),
        straight(4, 60, 0, 60, predecessors=[3]),
    ]
    north = [
        Lanelet(
            i,
            left=[(48.5, low), (48.5, high)],
            right=[(51.5, low), (51.5, high)],
            successors=after,
            predecessors=before,
        )
        for i, low, high, before, after in (
            (5, -80, -10, [], [6]),
            (6, -10, 10, [5], [7]),
            (7, 10, 80, [6], []),
        )
    ]
    road = read(tmp_path, east + north, signs=[Sign(90, "205")])
    net = convert(road, tmp_path / "crossing.net.xml")
    report = check_net(net.path, road, net.lanes)
    assert report.problems() == []
    assert (report["crossing"], report["free_foes"]) == (1, ())
    states = {link.get("state") for link in ElementTree.parse(net.path).iter("connection") if link.get("via")}
    assert states == {"m", "M"}  # one gives way, one goes first


@pytest.mark.parametrize("site", SITES)
def test_a_recorded_site_becomes_a_net_that_is_faithful(site: str, data: Path, tmp_path: Path) -> None:
    path = sorted((data / "mona" / site).glob("*.xml.gz"))[0]
    road = read_map(path)
    assert road.name == path.name.removesuffix(".xml.gz")
    report = judged(road, tmp_path / "site.net.xml")
    assert report["deviation_max_m"] <= 0.10
    assert report["deviation_p95_m"] <= 0.01
    assert (report["arrived"], report["teleports"], report["overlapping_pairs"]) == (120, 0, 0)
    assert report.problems() == []


def test_a_compressed_file_is_the_same_map(tmp_path: Path) -> None:
    text = scenario(crossing())
    (tmp_path / "a.xml").write_text(text, encoding="utf-8")
    (tmp_path / "a.xml.gz").write_bytes(gzip.compress(text.encode()))
    plain, packed = read_map(tmp_path / "a.xml"), read_map(tmp_path / "a.xml.gz")
    assert plain.name == packed.name == "a"
    assert_array_equal(plain.lanes[1].centreline, packed.lanes[1].centreline)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.xml", "<net/>", "it is a SUMO net already"),
        ("a.xml", "<osm/>", "rename it to .osm"),
        ("a.xml", "<OpenDRIVE/>", "it is OpenDRIVE"),
        ("a.xml", "<html/>", "its root is <html>"),
        ("a.xml", "no xml", "not XML"),
        ("a.xml", "", "not XML"),
        ("a.xml", '<commonRoad commonRoadVersion="2024"/>', "version '2024'"),
        ("a.xml", '<commonRoad commonRoadVersion="2020a"/>', "without lanelets"),
        (
            "a.xml",
            '<commonRoad commonRoadVersion="2020a"><lanelet id="1"/></commonRoad>',
            "no usable lane for cars",
        ),
        ("a.xml.gz", "\x1f\x8b broken", "not XML"),
        ("a.xodr", "<OpenDRIVE/>", "none of its 0 roads has geometry and lanes"),
    ],
)
def test_what_is_no_commonroad_map_is_refused_in_one_line(
    name: str, content: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(content, encoding="utf-8")
    with pytest.raises(MapError) as refused:
        read_map(tmp_path / name)
    assert said in str(refused.value)
    assert str(tmp_path / name) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_without_commonroad_io_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_scenario(tmp_path / "map.xml", [straight(1, 0, 0, 50)])
    real_import = builtins.__import__

    def no_commonroad(name: str, *rest: Any, **named: Any) -> Any:
        if name.startswith("commonroad"):
            raise ImportError(f"No module named {name!r}")
        return real_import(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", no_commonroad)
    with pytest.raises(MissingExtraError, match=r"pip install '\.\[formats\]'"):
        read_commonroad_road(path)


BROKEN = {
    "id used twice": ([straight(1, 0, 9, 50)], "ids used twice, the first lanelet kept: 1"),
    "no id": ([Lanelet("x", [(0, 9), (9, 9)], [(0, 6), (9, 6)])], "id is no positive number: x"),
    "negative id": ([straight(-4, 0, 9, 50)], "id is no positive number: -4"),
    "no bound": ([Lanelet(5, [], [(0, 6), (9, 6)])], "shorter than two points: 5"),
    "one place": ([Lanelet(5, [(0, 9), (0, 9)], [(0, 6), (9, 6)])], "shorter than two points: 5"),
    "no number": ([Lanelet(5, [(0, float("nan")), (9, 9)], [(0, 6), (9, 6)])], "no usable coordinates: 5"),
    "far away": ([Lanelet(5, [(0, 1e12), (9, 9)], [(0, 6), (9, 6)])], "no usable coordinates: 5"),
    "unknown type": ([straight(5, 0, 9, 50, types=["rail"])], "a laneletType that CommonRoad does not have"),
    "successor": ([straight(5, 0, 9, 50, successors=[77])], "a successor that is not there, dropped: 5"),
    "itself": ([straight(5, 0, 9, 50, successors=[5])], "a successor that is not there, dropped: 5"),
    "neighbour": ([straight(5, 0, 9, 50, left_of=(77, "same"))], "an? adjacentLeft that is not there"),
    "sign": ([straight(5, 0, 9, 50, signs=[77])], "a trafficSignRef that is not there, dropped: 5"),
    "far successor": ([straight(5, 0, 9, 50, successors=[1])], "more than 1 m from the end: 5-1"),
    "stop line": (
        [straight(5, 0, 9, 50, stop_line=StopLine(points=[(0, 0)]))],
        "an unusable stop line, left out: 5",
    ),
    "crossing bounds": (
        [Lanelet(5, [(0, 9), (25, 9), (50, 6)], [(0, 6), (25, 6), (50, 9)])],
        "bounds cross each other or themselves, the lane's shape may be off: 5",
    ),
    "no length between": (
        [Lanelet(5, [(0, 9), (9, 9)], [(9, 9), (0, 9)])],
        "lanes left out, no usable line: 5",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_mended_or_left_out_and_named(name: str, tmp_path: Path) -> None:
    broken, said = BROKEN[name]
    road = read(tmp_path, [straight(1, 0, 0, 50), *broken])
    assert_array_equal(road.lanes[1].centreline, [(0, 0), (50, 0)])
    assert any(said.replace("an?", "a") in note for note in road.notes), road.notes
    convert(road, tmp_path / "map.net.xml")


def test_an_unknown_sign_is_left_out_without_a_word_on_the_terminal(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        road = read(tmp_path, crossing(signs=[90]), signs=[Sign(90, "4711")], benchmark="XYZ_Test-1_1_T-1")
    assert road.regulations == ()
    assert "signs that commonroad-io does not know, left out: 90" in road.notes
    assert caplog.records == []


@pytest.mark.parametrize("seed", range(20))
def test_damaged_files_are_read_or_refused_in_one_line(seed: int, tmp_path: Path) -> None:
    """Whatever is cut out of a scenario or overwritten in it: a road that converts, or a MapError."""
    draw = random.Random(seed)
    text = scenario(
        [
            *side_by_side("dashed", "solid"),
            straight(3, 50, 0, 40, predecessors=[1], signs=[90], stop_line=StopLine(signs=[90])),
            *[Lanelet(4, [(60, -40), (60, 40)], [(64, -40), (64, 40)], lights=[80])],
        ],
        signs=[Sign(90, "274", ["13.9"]), Sign(91, "205")],
        lights=[80],
        intersections={100: [[3], [4]]},
    )
    pieces = text.replace("<", "\n<").split("\n")[1:]
    for _ in range(draw.randint(1, 4)):
        k = draw.randrange(3, len(pieces))
        kind = draw.randrange(3)
        if kind == 0:
            pieces[k] = draw.choice(pieces)
        elif kind == 1 and ">" in pieces[k]:
            pieces[k] = pieces[k].split(">")[0] + ">" + draw.choice(["", "x", "-1", "nan", "1e300", "7"])
        else:
            old = draw.choice("0123456789")
            pieces[k] = pieces[k].replace(old, draw.choice(["", "-", "9999999999", "3", "2"]))
    path = tmp_path / "damaged.xml"
    path.write_text("".join(pieces), encoding="utf-8")
    try:
        road = read_commonroad_road(path)
    except MapError as error:
        assert "\n" not in str(error)
        return
    assert all(np.isfinite(lane.centreline).all() for lane in road.lanes.values())
    if road.vehicle_lanes:
        convert(road, tmp_path / "damaged.net.xml")
