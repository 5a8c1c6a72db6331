"""Maps with missing relations, unknown subtypes, torn joints and cut lanelets become nets that drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.generators.demand import Network
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Lane
from tests.converters.sumo_roads import NetFile, lane, road
from tests.lanelet2sumo.judge.driving import judged
from tests.lanelet2sumo.judge.report import check_net
from tests.lanelet2sumo.mutated.cut_roads import cut_road
from tests.lanelet2sumo.mutated.mutations import example, lit, read, renamed, torn, without

CROSSING = "urban_intersection"
APPROACHES = ((30000, 30001), (30008,), (30012, 30013), (30020, 30021))
INSIDE = range(30028, 30040)  # the lanelets across the intersection


def test_lights_that_no_lanelet_names_make_the_net_of_lights_that_are_named(tmp_path: Path) -> None:
    nets = []
    for named in (True, False):
        a_road = read(lit(example(CROSSING), APPROACHES, named=named), tmp_path)
        report = judged(a_road, tmp_path / "mutated.net.xml")
        assert report.problems() == []
        assert report["signalled"] == 7
        nets.append(NetFile(tmp_path / "mutated.net.xml"))
        assert len(a_road.notes) == (0 if named else 1)
    lights = [
        {name: c.get("tl") for name, c in net.connections.items() if c.get("tl") is not None} for net in nets
    ]
    assert lights[0] == lights[1]
    assert len(lights[0]) == len(INSIDE)


def test_lights_without_an_element_belong_to_the_stop_line_they_stand_at(tmp_path: Path) -> None:
    a_road = read(lit(example(CROSSING), APPROACHES, named=False, element=False), tmp_path)
    assert {i for rule in a_road.regulations if rule.kind == "traffic_light" for i in rule.lanes} == {
        i for approach in APPROACHES for i in approach
    }
    assert a_road.losses == ()
    assert judged(a_road, tmp_path / "mutated.net.xml").problems() == []


def test_connected_lanelets_of_unknown_subtype_are_roads_with_a_note(tmp_path: Path) -> None:
    whole = read(example(CROSSING), tmp_path)
    a_road = read(renamed(example(CROSSING), range(30000, 30016), subtype="main_road"), tmp_path)
    assert a_road.vehicle_lanes.keys() == whole.vehicle_lanes.keys()
    assert a_road.notes[0].startswith("lanelets of unknown subtype main_road taken for roads: 30000, ")
    assert a_road.losses == ()


def test_unknown_lanelets_beside_the_road_are_a_loss_that_the_judge_counts(tmp_path: Path) -> None:
    a_road = read(renamed(example(CROSSING), [30040], subtype="moving_walkway"), tmp_path)
    assert [str(loss) for loss in a_road.losses] == [
        "1 of 41 lanelets (2%) not driven, subtype moving_walkway: 30040"
    ]
    report = check_net(convert(a_road, tmp_path / "lost.net.xml").path, a_road)
    assert report["lanes_percent"] == pytest.approx(100 * 40 / 41)


def test_lanelets_that_meet_without_shared_points_are_linked(tmp_path: Path) -> None:
    a_road = read(torn(example(CROSSING), 30008), tmp_path)
    assert a_road.lanes[30008].predecessors == (30010,)
    assert a_road.lanes[30008].successors == ()  # three lanelets begin there: which one is meant?
    assert a_road.notes[0] == "lanelets that meet without shared points, linked: 30008, 30010"


def test_nobody_starts_on_lanelets_that_begin_within_an_intersection(tmp_path: Path) -> None:
    whole = cut_road(read(example(CROSSING), tmp_path), 3)
    gone = {3 * i for i in (30031, 30035)}  # the first third of two ways across
    kept = {i: lane for i, lane in whole.lanes.items() if i not in gone}
    rules = []
    for rule in whole.regulations:
        left = {
            k: tuple(i for i in getattr(rule, k) if i not in gone) for k in ("lanes", "yielding", "priority")
        }
        rules.append(replace(rule, **left))
    lanes = {i: _without(lane, gone) for i, lane in kept.items()}
    a_road = replace(whole, lanes=lanes, regulations=tuple(rules))
    report = judged(a_road, tmp_path / "mutated.net.xml")
    assert (report["arrived"], report["overlapping_pairs"], report["teleports"]) == (120, 0, 0)
    assert {edge for edge, _ in Network(tmp_path / "mutated.net.xml").origins} == {
        f"l{3 * i}" for i in (30006, 30010, 30018, 30026)
    }


def _without(lane: Lane, gone: set[int]) -> Lane:
    return replace(
        lane,
        successors=tuple(i for i in lane.successors if i not in gone),
        predecessors=tuple(i for i in lane.predecessors if i not in gone),
        conflicts=tuple(i for i in lane.conflicts if i not in gone),
    )


@pytest.mark.parametrize("seed", range(2))
def test_a_map_that_lost_some_of_its_lanelets_is_converted_faithfully(seed: int, tmp_path: Path) -> None:
    whole = example(CROSSING)
    ids = sorted(whole.of_type("lanelet"))
    gone = np.random.default_rng(seed).choice(ids, 9, replace=False).tolist()
    assert judged(read(without(whole, gone), tmp_path), tmp_path / "mutated.net.xml").problems() == []


@pytest.mark.parametrize(
    ("name", "seed", "parts"), [("roundabout", 3, 1), (CROSSING, 8, 3), (CROSSING, 20, 3)]
)
def test_lanelets_that_end_within_others_are_judged_by_the_links_that_meet(
    name: str, seed: int, parts: int, tmp_path: Path
) -> None:
    whole = example(name)
    gone = np.random.default_rng(seed).choice(sorted(whole.of_type("lanelet")), 9, replace=False).tolist()
    a_road = cut_road(read(without(whole, gone), tmp_path), parts)
    net = convert(a_road, tmp_path / "mutated.net.xml")
    assert check_net(net.path, a_road, net.lanes).problems() == []


@pytest.mark.parametrize(
    ("name", "parts"), [(CROSSING, 3), ("roundabout", 2), ("roundabout", 3), ("motorway_merge", 2)]
)
def test_roads_cut_into_the_junction_keep_every_conflict(name: str, parts: int, tmp_path: Path) -> None:
    assert (
        judged(cut_road(read(example(name), tmp_path), parts), tmp_path / "mutated.net.xml").problems() == []
    )


def test_lanes_that_are_crossed_along_their_whole_length_are_not_changed_between(tmp_path: Path) -> None:
    across = [lane(10 + k, [(x, -40), (x, 40)]) for k, x in enumerate((-3, 0, 3))]
    rows = [
        lane(
            2 * k + side,
            [(x, 3.5 * side), (y, 3.5 * side)],
            to=(2 * k + side + 2,) if k < 2 else (),
            **beside,
        )
        for k, (x, y) in enumerate(((-60, -5), (-5, 5), (5, 60)))
        for side, beside in ((0, {"left": 2 * k + 1}), (1, {"right": 2 * k}))
    ]
    a_road = road([*rows, *across])
    report = judged(a_road, tmp_path / "mutated.net.xml")
    assert report.problems() == []
    assert report["lane_changes_inside"] == ((2, 3), (3, 2))
