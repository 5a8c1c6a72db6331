"""Right of way of nets converted from small roads drawn by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Lane, Regulation, Road
from tests.converters.sumo_roads import NetFile, arc, lane, load, road
from tests.lanelet2sumo.judge.driving import drive_net
from tests.lanelet2sumo.judge.report import check_net


def net_of(drawn: Road, folder: Path) -> NetFile:
    """Convert, let sumo judge the file, and read it."""
    net = convert(drawn, folder / "drawn.net.xml")
    assert load(net.path, "-a", str(net.extras)) == ""
    return NetFile(net.path)


def crossing() -> list[Lane]:
    """Lane 1 runs east, lane 2 north; they cross at the origin. Lane 1 has lane 2 on its right."""
    return [lane(1, [(-50, 0), (50, 0)]), lane(2, [(0, -50), (0, 50)])]


def test_who_comes_from_the_right_goes_first(tmp_path: Path) -> None:
    net = net_of(road(crossing()), tmp_path)
    east, north = net.via("l1#0", "l1#1"), net.via("l2#0", "l2#1")
    assert (east, north) in net.yields
    assert (north, east) not in net.yields
    assert {(east, north), (north, east)} <= net.foes


@pytest.mark.parametrize("named", ["lanes across", "approaches", "both sides of one rule"])
def test_a_right_of_way_element_decides_whichever_lanes_it_names(tmp_path: Path, named: str) -> None:
    lanes = [
        lane(1, [(-80, 0), (-20, 0)], to=(3,)),
        lane(2, [(0, -80), (0, -20)], to=(4,)),
        lane(3, [(-20, 0), (20, 0)]),
        lane(4, [(0, -20), (0, 20)]),
        lane(5, [(15, 40), (15, -40)]),
    ]
    # In one rule for a whole junction the lane with priority may yield to a third one.
    sides = {
        "lanes across": ((4,), (3,)),
        "approaches": ((2,), (1,)),
        "both sides of one rule": ((3, 4), (3, 5)),
    }
    yielding, priority = sides[named]
    rule = Regulation(
        element_id=9, kind="right_of_way", lanes=yielding + priority, yielding=yielding, priority=priority
    )
    net = net_of(road(lanes, [rule]), tmp_path)
    [east] = [v for v, c in net.connections.items() if c.get("to") == "l3#1"]
    [north] = [v for v, c in net.connections.items() if c.get("to") == "l4#1"]
    assert (north, east) in net.yields  # although lane 2 comes from the right
    assert (east, north) not in net.yields
    assert net.connections[north].get("state") == "m"
    assert net.connections[east].get("state") == "M"


def test_a_rule_of_a_lane_before_a_fork_holds_for_the_branch_that_meets_the_other_lane(
    tmp_path: Path,
) -> None:
    """Lane 2 forks into 3, straight on, and 4, which turns right and merges with 5 from the left."""
    lanes = [
        lane(2, [(-60, 0), (-20, 0)], to=(3, 4)),
        lane(3, [(-20, 0), (80, 0)]),
        lane(4, arc((-20, -20), 20, 90, 0), to=(6,)),
        lane(5, [(0, 60), (0, -20)], to=(6,)),
        lane(6, [(0, -20), (0, -80)]),
    ]
    named = [((5,), (3,)), ((2,), (5,))]
    rules = [
        Regulation(element_id=9 + k, kind="right_of_way", lanes=y + p, yielding=y, priority=p)
        for k, (y, p) in enumerate(named)
    ]
    for known, turn_yields in ((rules[:1], False), (rules, True)):
        drawn = road(lanes, known)
        net = net_of(drawn, tmp_path)
        turning, south = net.via("l4", "l6"), net.via("l5#1", "l6")
        assert ((turning, south) in net.yields, (south, turning) in net.yields) == (
            turn_yields,
            not turn_yields,
        )
        assert check_net(tmp_path / "drawn.net.xml", drawn, None).problems() == []


def intersection() -> list[Lane]:
    """Arms 0 to 3, each a quarter turn to the left of the one before.

    Lanes of an arm are its number plus 10 for the approach, 20 straight on, 30 left, 40 right; an exit is 50
    plus the arm from which traffic goes straight on into it.
    """
    lanes = []
    for k, (c, s) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
        lines = {
            10: [(-80, -2), (-16, -2)],
            20: [(-16, -2), (16, -2)],
            30: [(-16, -2), (-10, -2), *arc((-10, 10), 12, -85, 0), (2, 16)],
            40: [(-16, -2), *arc((-16, -16), 14, 85, 0)],
            50: [(16, -2), (80, -2)],
        }
        ends = {10: (20 + k, 30 + k, 40 + k), 20: (50 + k,), 30: (50 + (k + 1) % 4,), 40: (50 + (k + 3) % 4,)}
        for kind, line in lines.items():
            points = np.array(line, float) @ np.array([[c, s], [-s, c]])
            lanes.append(lane(kind + k, points, to=ends.get(kind, ())))
    return lanes


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        pytest.param([((10, 12), (11, 13))], [(20, 21), (22, 23), (30, 21)], id="several yield to several"),
        pytest.param([((40,), (53,))], [(40, 23), (40, 32)], id="the lane merged into has priority"),
        pytest.param([((20,), (23,)), ((20,), (21,))], [(20, 23), (20, 21)], id="a lane of two elements"),
        pytest.param([((20, 22), (21, 23)), ((30,), (22,))], [(20, 21), (30, 22)], id="a way in both roles"),
        pytest.param(
            [((31, 10), (13, 11, 20)), ((10,), (12,))], [(31, 20)], id="an approach in a weaker rule"
        ),
        pytest.param([((10,), (11,)), ((11,), (20,))], [(21, 20), (30, 21)], id="a way against its approach"),
    ],
)
def test_each_element_of_an_intersection_decides(
    tmp_path: Path, rules: list[tuple[tuple[int, ...], ...]], expected: list[tuple[int, int]]
) -> None:
    elements = [
        Regulation(element_id=9 + k, kind="right_of_way", lanes=y + p, yielding=y, priority=p)
        for k, (y, p) in enumerate(rules)
    ]
    net = convert(road(intersection(), elements), tmp_path / "drawn.net.xml")
    yields = NetFile(net.path).yields
    for pair in expected:
        one, other = (net.lanes.sumo_lanes(i)[-1] for i in pair)
        assert (one, other) in yields
        assert (other, one) not in yields


def test_at_an_all_way_stop_everyone_answers_everyone(tmp_path: Path) -> None:
    rule = Regulation(element_id=9, kind="all_way_stop", lanes=(1, 2), yielding=(1, 2))
    net = net_of(road(crossing(), [rule]), tmp_path)
    east, north = net.via("l1#0", "l1#1"), net.via("l2#0", "l2#1")
    assert {(east, north), (north, east)} <= net.yields
    assert net.state("l1#0", "l1#1") == net.state("l2#0", "l2#1") == "w"


@pytest.mark.parametrize(("kind", "state"), [("stop", "s"), ("yield", "m")])
def test_a_sign_makes_its_lane_give_way(tmp_path: Path, kind: str, state: str) -> None:
    rule = Regulation(element_id=9, kind=kind, lanes=(2,), yielding=(2,))
    net = net_of(road(crossing(), [rule]), tmp_path)
    east, north = net.via("l1#0", "l1#1"), net.via("l2#0", "l2#1")
    assert (north, east) in net.yields
    assert (east, north) not in net.yields
    assert net.state("l2#0", "l2#1") == state


def test_left_turns_give_way_to_oncoming_traffic(tmp_path: Path) -> None:
    lanes = [
        lane(1, [(-60, -2), (-15, -2)], to=(2,)),
        lane(2, np.vstack([[(-15, -2)], arc((-12, 12), 14, -80, 0), [(2, 20)]]), to=(3,)),
        lane(3, [(2, 20), (2, 60)]),
        lane(4, [(60, 2), (-60, 2)]),
    ]
    net = net_of(road(lanes), tmp_path)
    [left] = [v for v, c in net.connections.items() if c.get("dir") in ("l", "L")]
    [straight] = [v for v, c in net.connections.items() if c.get("from") == "l4#0"]
    assert (left, straight) in net.yields
    assert (straight, left) not in net.yields


def test_a_fork_has_no_foes(tmp_path: Path) -> None:
    lanes = [
        lane(1, [(0, 0), (50, 0)], to=(2, 3)),
        lane(2, [(50, 0), (100, 0)]),
        lane(3, [(50, 0), (75, 4), (100, 15)]),
    ]
    net = net_of(road(lanes), tmp_path)
    assert net.foes == set()
    assert {c.get("to") for c in net.connections.values() if c.get("from") == "l1"} == {"l2", "l3"}


def test_a_one_way_ban_forbids_one_direction_only(tmp_path: Path) -> None:
    lanes = [lane(1, [(0, 0), (90, 0)], left=2), lane(2, [(0, 3.5), (90, 3.5)])]
    net = net_of(road(lanes), tmp_path)
    right, left = net.lanes["l1_0"], net.lanes["l1_1"]
    assert right.get("changeLeft") is None
    assert right.get("changeRight") is not None
    assert left.get("changeRight") not in (None, "", "all")
    assert left.get("index") == "1"


def test_a_light_stops_whoever_refers_to_it(tmp_path: Path) -> None:
    rules = [Regulation(element_id=7 + i, kind="traffic_light", lanes=(i,)) for i in (1, 2)]
    net = net_of(road(crossing(), rules), tmp_path)
    [programme] = list(net.root.iter("tlLogic"))
    east, north = net.via("l1#0", "l1#1"), net.via("l2#0", "l2#1")
    places = {via: int(net.connections[via].get("linkIndex", "")) for via in (east, north)}
    states = [phase.get("state", "") for phase in programme.iter("phase")]
    both = [(state[places[east]], state[places[north]]) for state in states]
    assert {pair[0] for pair in both} == {pair[1] for pair in both} == {"G", "y", "r"}
    assert all("r" in pair for pair in both)


def test_a_ring_without_an_edge_of_its_own_keeps_every_way(tmp_path: Path) -> None:
    """A mini roundabout: four lanes in a ring of 6 m radius, each both joined and left at its ends."""
    ring = [
        lane(10 + k, arc((0, 0), 6, 90 * k, 90 * k + 90), to=(10 + (k + 1) % 4, 30 + k)) for k in range(4)
    ]
    turned = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in np.pi / 2 * np.arange(4)]
    into = [
        lane(20 + k, np.array([(40, -2), (10, -2), (6, 0)]) @ turned[k].T, to=(10 + k,)) for k in range(4)
    ]
    out = [lane(30 + k, np.array([(0, 6), (2, 10), (2, 40)]) @ turned[k].T) for k in range(4)]
    drawn = road([*ring, *into, *out])
    net = convert(drawn, tmp_path / "ring.net.xml")
    assert load(net.path) == ""
    following: dict[str, set[str]] = {}
    for c in NetFile(net.path).connections.values():
        following.setdefault(c.get("from", ""), set()).add(c.get("to", ""))
    for start in range(20, 24):
        seen, stack = set(), [net.lanes.edges([start])[0]]
        while stack:
            edge = stack.pop()
            if edge not in seen:
                seen.add(edge)
                stack += following.get(edge, set())
        assert {net.lanes.edges([end])[-1] for end in range(30, 34)} <= seen


def test_one_lane_for_both_ways_lets_one_way_through_at_a_time(tmp_path: Path) -> None:
    """Lanes 1 and 2 are one strip of road, driven in both directions."""
    lanes = [
        lane(5, [(-90, -3), (0, 0)], to=(1,)),
        lane(1, [(0, 0), (50, 0)], to=(6,)),
        lane(6, [(50, 0), (140, -3)]),
        lane(7, [(140, 3), (50, 0)], to=(2,)),
        lane(2, [(50, 0), (0, 0)], to=(8,)),
        lane(8, [(0, 0), (-90, 3)]),
    ]
    net = convert(road(lanes), tmp_path / "strip.net.xml")
    assert load(net.path) == ""
    report = drive_net(net.path, vehicles=40)
    assert report["arrived"] == 40
    assert report["overlapping_pairs"] == 0


def test_no_edge_leaves_a_junction_and_enters_it_again(tmp_path: Path) -> None:
    """Lane 1 comes back as lane 3 and is crossed by it; netconvert refuses edges from a node to itself."""
    lanes = [
        lane(1, [(-40, 0), (30, 0)], to=(2,)),
        lane(2, arc((30, 15), 15, -90, 180), to=(3,)),
        lane(3, [(15, 15), (15, -50)]),
    ]
    net = net_of(road(lanes), tmp_path)
    edges = [x for x in net.root.iter("edge") if x.get("function") is None]
    assert [x.get("id") for x in edges if x.get("from") == x.get("to")] == []


def test_a_roundabout_without_rules_goes_before_its_entry(tmp_path: Path) -> None:
    """Right before left would let the entry first, and lock the ring."""
    lanes = [
        lane(1, arc((0, 0), 20, 0, 180), to=(2,)),
        lane(2, arc((0, 0), 20, 180, 360), to=(1,)),
        lane(3, [(60, -30), (35, -25), (24, -12), (20, 0)], to=(1,)),
    ]
    net = net_of(road(lanes), tmp_path)
    [entry] = [v for v, c in net.connections.items() if c.get("from", "").startswith("l3")]
    [ring] = [other for one, other in net.foes if one == entry]
    assert (entry, ring) in net.yields
    assert (ring, entry) not in net.yields


def test_a_lane_without_length_is_named(tmp_path: Path) -> None:
    drawn = road([lane(1, [(0, 0), (50, 0)])])
    flat = replace(drawn.lanes[1], lane_id=7, centreline=np.zeros((2, 2)))
    with pytest.raises(MapError, match="lanelets without length: 7"):
        convert(replace(drawn, lanes={**drawn.lanes, 7: flat}), tmp_path / "flat.net.xml")
