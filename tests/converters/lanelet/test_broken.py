"""Broken maps: mended or left out and said so, or one clear error; never a crash of the process.

Maps that crash Lanelet2 are read in a process of their own, so that a crash shows as a failure here.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from tests.command import script
from tests.converters.maps import Line, draw_map, rule, straight
from tests.lanelet2sumo.judge.report import check_net

READ = """
import sys
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.base.errors import ScexError
for path in sys.argv[1:]:
    print(path, flush=True)
    try:
        road = read_road(path)
        print("lanes", *road.lanes)
        print("notes", *road.notes, sep="|")
    except ScexError as error:
        print("error", error)
"""


def read_apart(*paths: Path) -> str:
    """Read maps in another process; fails where that process dies."""
    done = script(READ, *paths)
    assert done.returncode == 0, f"exit {done.returncode} after {done.stdout[-300:]!r}: {done.stderr[-600:]}"
    return done.stdout


def two_lanes() -> str:
    """Lanelets 1 and 2 in a row; nodes 100000 to 100005, ways 200000 to 200003."""
    return draw_map([straight(1, 0, 50), straight(2, 50, 90)])


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "broken.osm"
    path.write_text(text, encoding="utf-8")
    return path


def one_note(road: Road) -> str:
    (note,) = road.notes
    return note


# Ways to break the map of two lanes, and what the note must say; lane 1 is the one that is hit.
LEFT_OUT: dict[str, tuple[Callable[[str], str], str]] = {
    "a bound is missing": (
        lambda text: text.replace("<member type='way' ref='200000' role='left'/>", ""),
        "bounds are missing, .*: 1$",
    ),
    "a bound's way is missing": (
        lambda text: text.replace("<way id='200000'>", "<way id='299999'>"),
        "bounds are missing, .*: 1$",
    ),
    "a bound is empty": (
        lambda text: text.replace("<nd ref='100000'/><nd ref='100001'/>", ""),
        "bounds are missing, .*: 1$",
    ),
    "a bound has one point": (
        lambda text: text.replace("<nd ref='100000'/><nd ref='100001'/>", "<nd ref='100001'/>"),
        "bounds are missing, .*: 1$",
    ),
    "a bound stands still": (
        lambda text: text.replace("<nd ref='100000'/>", "<nd ref='100001'/>"),
        "bounds are missing, .*: 1$",
    ),
    "a bound's node is missing": (
        lambda text: text.replace("node id='100000'", "node id='999999'"),
        "bounds are missing, .*: 1$",
    ),
    "two bounds on one side": (
        lambda text: text.replace("ref='200000' role='left'/>", "ref='200000' role='left'/>" + EXTRA),
        "bounds are missing, in pieces .*: 1$",
    ),
    "one way is both bounds": (
        lambda text: text.replace("ref='200001' role='right'", "ref='200000' role='right'"),
        "one way is both their bounds: 1$",
    ),
    "a node is not a number": (
        lambda text: text.replace("<node id='100000' lat='", "<node id='100000' lat='nan' old='"),
        "no usable id or coordinates: node 100000",
    ),
    "a node is off the Earth": (
        lambda text: text.replace("<node id='100000' lat='", "<node id='100000' lat='1e9' old='"),
        "no usable id or coordinates: node 100000",
    ),
    "a node is far away": (
        lambda text: text.replace("<node id='100000' lat='", "<node id='100000' lat='48.5' old='"),
        "nodes over 50 km away from the map, left out: 100000",
    ),
}
EXTRA = "<member type='way' ref='200002' role='left'/><member type='way' ref='200003' role='left'/>"


@pytest.mark.parametrize("defect", LEFT_OUT)
def test_a_lanelet_without_two_bounds_is_left_out_and_named(tmp_path: Path, defect: str) -> None:
    break_it, said = LEFT_OUT[defect]
    broken = break_it(two_lanes())
    assert broken != two_lanes()
    output = read_apart(written(tmp_path, broken))
    assert "lanes 2\n" in output
    road = read_road(tmp_path / "broken.osm")
    assert list(road.lanes) == [2]
    assert any(re.search(said, note) for note in road.notes), road.notes


def test_bounds_in_pieces_are_joined(tmp_path: Path) -> None:
    pieces = [Line(7, [(80, 3.5), (50, 3.5)]), Line(8, [(50, 0), (80, 0)])]  # 7 is drawn backwards
    text = draw_map([straight(1, 0, 50)], lines=pieces)
    for side, way in (("left", 7), ("right", 8)):
        member = f"role='{side}'/>"
        text = text.replace(member, f"{member}<member type='way' ref='{way}' {member}")
    road = read_road(written(tmp_path, text))
    np.testing.assert_allclose(road.lanes[1].left_bound, [(0, 3.5), (50, 3.5), (80, 3.5)], atol=1e-6)
    np.testing.assert_allclose(road.lanes[1].right_bound, [(0, 0), (50, 0), (80, 0)], atol=1e-6)
    assert one_note(road) == "lanelets with bounds in several pieces, joined: 1"


def test_a_bound_that_ends_in_a_loop_is_joined_also_if_the_loop_is_listed_first(tmp_path: Path) -> None:
    loop = [(50, 3.5), (52, 6), (48, 6), (50, 3.5)]
    text = draw_map([straight(1, 0, 50)], lines=[Line(7, loop)])
    first = "<member type='way' ref='7' role='left'/>"
    text = re.sub("(<member [^>]* role='left'/>)", rf"{first}\1", text)
    road = read_road(written(tmp_path, text))
    np.testing.assert_allclose(
        sorted(road.lanes[1].left_bound.tolist()), sorted([(0, 3.5), *loop]), atol=1e-6
    )


def test_lanelets_that_cannot_be_read_are_a_loss_with_its_share(tmp_path: Path) -> None:
    text = two_lanes().replace("relation id='1'", "relation id='one'")
    (loss,) = read_road(written(tmp_path, text)).losses
    assert str(loss) == "1 of 2 lanelets (50%) left out, broken: one"
    assert loss.note == f"warning: {loss}"
    few = replace(loss, of=100)  # 1 %
    assert few.note == str(few) == "1 lanelets left out, broken: one"


def test_a_rule_that_refers_to_nothing_is_used_without(tmp_path: Path) -> None:
    element = rule(90, "right_of_way", [("yield", 1), ("right_of_way", 77), ("ref_line", 78)])
    text = draw_map([straight(1, 0, 50, rules=[90, 91]), straight(2, 50, 90)], relations=[element])
    road = read_road(written(tmp_path, text))
    assert (road.regulations[0].yielding, road.regulations[0].priority) == ((1,), ())
    assert "regulatory elements that refer to missing elements, used without: 90" in road.notes
    assert "lanelets that refer to missing elements, used without: 1" in road.notes


NO_MAPS = {
    "nothing": ("", "not XML"),
    "text": ("lanelet,lane\n1,2\n", "not XML"),
    "cut off": (two_lanes()[:-40], "not XML"),
    "binary": ("\x00\x01\x02", "not XML"),
    "a SUMO net": ("<net version='1.20'><edge id='a'/></net>", "root is <net>, not <osm>"),
    "CommonRoad": ("<commonRoad><lanelet id='1'/></commonRoad>", "root is <commonRoad>"),
    "an empty map": ("<osm version='0.6'/>", "no lanelets"),
    "OpenStreetMap": (
        "<osm version='0.6'><node id='1' lat='49' lon='8'/><node id='2' lat='49.1' lon='8'/>"
        "<way id='3'><nd ref='1'/><nd ref='2'/><tag k='highway' v='primary'/></way></osm>",
        "no lanelets",
    ),
    "lanelets without nodes": (
        "<osm><relation id='1'><tag k='type' v='lanelet'/></relation></osm>",
        "no usable nodes",
    ),
    "a map in metres": ("<osm><node id='1' x='990.1' y='1012.3'/></osm>", "have x, y instead of lat, lon"),
    "only broken lanelets": (two_lanes().replace("role='left'", "role='lost'"), "no usable lanelet .*: 1, 2"),
}


@pytest.mark.parametrize("what", NO_MAPS)
def test_what_is_no_map_is_one_clear_error(tmp_path: Path, what: str) -> None:
    text, said = NO_MAPS[what]
    with pytest.raises(MapError, match=said) as error:
        read_road(written(tmp_path, text))
    assert str(error.value).startswith(f"{tmp_path / 'broken.osm'}: ")
    assert "\n" not in str(error.value)


def test_ways_that_end_at_one_place_in_two_nodes_are_linked(tmp_path: Path) -> None:
    text = draw_map([straight(1, 0, 50), straight(2, 50, 90)])
    whole = read_road(written(tmp_path, text))
    road = read_road(written(tmp_path, _apart(text)))
    assert [lane.successors for lane in road.lanes.values()] == [
        lane.successors for lane in whole.lanes.values()
    ]
    assert one_note(road).startswith("nodes at the place of another, taken for that one: ")


def test_a_centreline_drawn_on_a_bound_is_computed(tmp_path: Path) -> None:
    text = two_lanes().replace("<member type='way' ref='200000' role='left'/>", "", 0)
    left = re.search(r"<member [^>]*role=.left.[^>]*/>", text)
    assert left is not None
    road = read_road(
        written(tmp_path, text.replace(left[0], left[0] + left[0].replace("left", "centerline"), 1))
    )
    whole = read_road(written(tmp_path, two_lanes()))
    assert np.allclose(road.lanes[1].centreline, whole.lanes[1].centreline)
    assert one_note(road) == "lanelets with a broken centreline, computed from their bounds: 1"


def _apart(text: str) -> str:
    """The map with nodes of its own for the last lanelet's bounds."""
    nodes = re.findall(r"<node .*?(?:/>|</node>)", text, re.DOTALL)
    fresh = [re.sub(r"id=(['\"])1", r"id=\g<1>9", node, count=1) for node in nodes]
    text = text.replace(nodes[-1], "\n".join([nodes[-1], *fresh]))
    return re.sub(
        r"<way id=.20000[23].*?</way>",
        lambda way: re.sub(r"ref=(['\"])1", r"ref=\g<1>9", way[0]),
        text,
        flags=re.DOTALL,
    )


def test_a_lanelet_missing_between_two_is_added_where_one_goes_on_behind_it(tmp_path: Path) -> None:
    lanes = straight(1, 0, 50, y=7.0), straight(3, 0, 50), straight(5, 50.0, 90, y=3.5)
    road = read_road(written(tmp_path, draw_map([*lanes])))
    (added,) = set(road.lanes) - {1, 3, 5}
    assert one_note(road) == f"lanelets missing between two others, added between their bounds: {added}"
    assert road.lanes[added].successors == (5,)
    assert road.lanes[added].width_m == pytest.approx(3.5)


@pytest.mark.parametrize(
    "bent", [[(0, 3), (20, 3), (20, 2), (10, 4), (50, 3)], [(0, 3), (20, 3), (25, -0.5), (30, 3), (50, 3)]]
)
def test_bounds_that_cross_are_named(bent: list[tuple[float, float]], tmp_path: Path) -> None:
    """One crosses itself, the other one crosses the right bound twice."""
    lanes = [replace(straight(1, 0, 50, width=3), left=bent), straight(2, 50, 90, width=3)]
    road = read_road(written(tmp_path, draw_map(lanes)))
    assert one_note(road) == "bounds cross each other or themselves, the lane's shape may be off: 1"


@pytest.mark.parametrize("length", [0.02, 0.2, 0.36, 0.59])
def test_a_stub_beside_the_beginning_of_a_lane_is_no_gap_before_it(length: float, tmp_path: Path) -> None:
    lanes = [straight(1, 0, 30), straight(2, 30, 60), straight(3, 30, 30 + length)]
    road = read_road(written(tmp_path, draw_map(lanes)))
    assert road.lanes[1].successors == (2, 3) and not road.lanes[3].successors
    assert one_note(road) == "lanes that end or begin inside the map, where one may be missing: 3"
    net = convert(road, tmp_path / "stub.net.xml")
    assert check_net(net.path, road, net.lanes).problems() == []
