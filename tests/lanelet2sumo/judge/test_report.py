"""The judge of a conversion finds every defect that is put into a faithful net, and no other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from scex_sumo.base.errors import InputError
from scex_sumo.formats.sumo.net import read_sumo_road
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.lanelet2sumo.judge.report import FidelityReport
from tests.converters.plain_net import Table, crossing, lane, write_net
from tests.lanelet2sumo.judge.report import check_net

SPARE = (
    '<edge id="spare" from="S" to="E">'
    '<lane id="spare_0" index="0" speed="9" length="30" shape="{shape}"{rules}/></edge><edge id="south"'
)


def judge(folder: Path, *edits: tuple[str, str]) -> FidelityReport:
    return check_net(write_net(folder, *edits), crossing(), Table())


def test_a_faithful_net_has_no_problems(tmp_path: Path) -> None:
    report = judge(tmp_path)
    assert report.problems() == []
    figures = report.figures
    assert json.loads(json.dumps(figures))["lanelets"] == 8
    assert figures["lanes_percent"] == figures["speeds_percent"] == 100.0
    assert (figures["successors"], figures["lane_changes"], figures["forbidden_lane_changes"]) == (6, 1, 1)
    assert (figures["crossing"], figures["merging"], figures["regulated_pairs"]) == (1, 1, 2)
    # From 1: 2, 3; from 7: 8, 6, and by the lane change 1, 2, 3; from 4: 5, 6; one each from 2, 5, 8.
    assert figures["routes"] == 2 + 5 + 2 + 3
    assert figures["border_routes"] == 4
    # All lanelets and all SUMO lanes are 3.5 m wide; bounds of the turn's bends are chords, a little nearer.
    assert figures["width_error_mean_m"] < 0.05


def test_without_a_table_lanelets_are_found_by_geometry(tmp_path: Path) -> None:
    assert check_net(write_net(tmp_path), crossing()).figures == judge(tmp_path).figures


def test_a_net_offset_is_taken_off(tmp_path: Path) -> None:
    road = crossing()
    shift = np.array([1000.0, -500.0])
    moved = {
        i: replace(
            one,
            centreline=one.centreline + shift,
            left_bound=one.left_bound + shift,
            right_bound=one.right_bound + shift,
        )
        for i, one in road.lanes.items()
    }
    net = write_net(tmp_path, ('netOffset="0.00,0.00"', 'netOffset="-1000.00,500.00"'))
    assert check_net(net, replace(road, lanes=moved), Table()).problems() == []


def test_a_net_whose_coordinates_have_an_offset_is_faithful_to_itself(tmp_path: Path) -> None:
    place = 'netOffset="0.00,0.00"', 'netOffset="-690000.00,-5700000.00"'
    road = read_sumo_road(write_net(tmp_path, place))
    net = convert(road, tmp_path / "copy.net.xml")
    assert check_net(net.path, road, net.lanes).problems() == []


def test_a_lane_shifted_by_20_cm_is_found(tmp_path: Path) -> None:
    report = judge(tmp_path, ('shape="15.00,0.00 60.00,0.00"', 'shape="15.00,0.20 60.00,0.20"'))
    assert report["deviation_max_m"] == pytest.approx(0.2, abs=1e-6)
    assert report["worst_deviations"] == ((3, pytest.approx(0.2, abs=1e-6)),)
    # One of eight lanelets, forth and back: an eighth of the samples, so the 95th percentile sees it.
    assert report["deviation_p95_m"] == pytest.approx(0.2, abs=1e-6)
    assert report["deviation_p50_m"] == pytest.approx(0.0, abs=1e-6)


def test_a_lane_that_runs_on_is_found(tmp_path: Path) -> None:
    report = judge(tmp_path, ('shape="15.00,0.00 60.00,0.00"', 'shape="15.00,0.00 65.00,0.00"'))
    assert report["overhangs"] == (("east_0", pytest.approx(5.0)),)
    assert report["deviation_max_m"] == pytest.approx(0.0, abs=1e-6)


def test_a_missing_lane_is_found(tmp_path: Path) -> None:
    road = crossing()
    extra = lane(10, [(30, 40), (60, 40)])
    report = check_net(write_net(tmp_path), replace(road, lanes={**road.lanes, 10: extra}), Table())
    assert report["missing_lanes"] == (10,)


def test_an_invented_lane_is_found(tmp_path: Path) -> None:
    report = judge(tmp_path, ('<edge id="south"', SPARE.format(shape="20,-40 50,-40", rules="")))
    assert report["invented_lanes"] == ("spare_0",)


def test_a_reversed_lane_is_found(tmp_path: Path) -> None:
    report = judge(tmp_path, ('shape="15.00,0.00 60.00,0.00"', 'shape="60.00,0.00 15.00,0.00"'))
    assert report["reversed_lanes"] == ((3, "east_0"),)


def test_a_walkway_open_to_cars_is_found(tmp_path: Path) -> None:
    class Wrong(Table):
        lanes: ClassVar[dict[int, str]] = {**Table.lanes, 9: "spare_0"}

    for rules, closed in (("", (9,)), (' allow="pedestrian"', ())):
        edit = ('<edge id="south"', SPARE.format(shape="4,-60 4,-15", rules=rules))
        report = check_net(write_net(tmp_path, edit), crossing(), Wrong())
        assert report["non_vehicle_as_cars"] == closed


def test_a_wrong_speed_limit_is_found(tmp_path: Path) -> None:
    report = judge(
        tmp_path, ('<lane id="east_0" index="0" speed="13.89"', '<lane id="east_0" index="0" speed="8.33"')
    )
    assert report["wrong_speeds"] == ((3, 13.89, 8.33),)
    assert report["speeds_right"] == 7


def test_a_missing_connection_is_found(tmp_path: Path) -> None:
    first = '<connection from="west" to="north" fromLane="1" toLane="0" via=":J_1_0" dir="l" state="M"/>'
    second = '<connection from=":J_1" to="north" fromLane="0" toLane="0" dir="l" state="M"/>'
    report = judge(tmp_path, (first, ""), (second, ""))
    assert report["missing_successors"] == ((7, 8), (8, 6))
    assert report["missing_routes"] == ((7, 6), (7, 8), (8, 6))
    assert report["missing_border_routes"] == ((7, 6),)
    assert report["invented_routes"] == ()


def test_an_invented_connection_is_found(tmp_path: Path) -> None:
    spare = (
        '<edge id=":J_3" function="internal"><lane id=":J_3_0" index="0" speed="9" length="22"'
        ' shape="0,-15 15,0"/></edge><edge id="south"'
    )
    turn = (
        '<connection from="south" to="east" fromLane="0" toLane="0" via=":J_3_0" dir="r" state="M"/>'
        '<connection from=":J_3" to="east" fromLane="0" toLane="0" dir="r" state="M"/></net>'
    )
    report = judge(tmp_path, ('<edge id="south"', spare), ("</net>", turn))
    assert report["invented_successors"] == ((4, 3),)
    assert report["invented_border_routes"] == ((4, 3),)
    assert report["missing_routes"] == ()
    assert report["invented_lanes"] == (":J_3_0",)


def test_a_forbidden_lane_change_that_is_possible_is_found(tmp_path: Path) -> None:
    report = judge(tmp_path, (' changeLeft="authority"', ""))
    assert report["invented_lane_changes"] == ((1, 7),)
    assert report["invented_border_routes"] == ((1, 6),)
    assert report["missing_lane_changes"] == ()


def test_a_permitted_lane_change_that_is_impossible_is_found(tmp_path: Path) -> None:
    text = 'width="3.50" shape="-60.00,3.50 -15.00,3.50"'
    report = judge(tmp_path, (text, text + ' changeRight="authority"'))
    assert report["missing_lane_changes"] == ((7, 1),)
    assert report["missing_border_routes"] == ((7, 3),)
    assert report["lane_change_length_share"] == 0.0


def test_a_missing_foe_is_found(tmp_path: Path) -> None:
    report = judge(
        tmp_path,
        ('<request index="0" response="000" foes="100"', '<request index="0" response="000" foes="000"'),
        ('<request index="2" response="011" foes="011"', '<request index="2" response="010" foes="010"'),
    )
    assert report["missing_foes"] == ((2, 5),)
    assert report["wrong_priority"] == ((5, 2),)
    assert report["foes_apart"] == ()


def test_the_wrong_one_yielding_is_found(tmp_path: Path) -> None:
    report = judge(
        tmp_path,
        ('<request index="0" response="000"', '<request index="0" response="100"'),
        ('<request index="2" response="011"', '<request index="2" response="010"'),
    )
    assert report["wrong_priority"] == ((5, 2),)
    assert report["mutual_yields"] == ()


def test_a_mutual_yield_is_found(tmp_path: Path) -> None:
    edit = ('<request index="0" response="000"', '<request index="0" response="100"')
    report = judge(tmp_path, edit)
    assert report["mutual_yields"] == ((":J_0_0", ":J_2_0"),)
    assert judge(tmp_path, edit, ('type="priority"', 'type="allway_stop"'))["mutual_yields"] == ()


def test_right_before_left_is_expected_where_no_rule_is(tmp_path: Path) -> None:
    # 5 comes from the right of 2, so without a rule 2 gives way; NET lets 5 give way.
    report = check_net(write_net(tmp_path), replace(crossing(), regulations=()), Table())
    assert report["from_the_right"] == 1
    assert report["wrong_from_the_right"] == ((2, 5),)
    road = crossing()
    alone = {i: replace(one, successors=(), predecessors=()) for i, one in road.lanes.items()}
    report = check_net(write_net(tmp_path), replace(road, lanes=alone, regulations=()), Table())
    assert report["wrong_from_the_right"] == ((2, 5),)
    swapped = write_net(
        tmp_path,
        ('<request index="0" response="000"', '<request index="0" response="100"'),
        ('<request index="2" response="011"', '<request index="2" response="010"'),
    )
    report = check_net(swapped, replace(crossing(), regulations=()), Table())
    assert report["wrong_from_the_right"] == ()


def test_a_traffic_light_that_controls_nothing_is_found(tmp_path: Path) -> None:
    road = crossing()
    light = replace(road.regulations[0], kind="traffic_light", lanes=(5,), yielding=(), priority=())
    report = check_net(write_net(tmp_path), replace(road, regulations=(light,)), Table())
    assert report["missing_signals"] == (5,)


def with_light(*states: str) -> list[tuple[str, str]]:
    """Edits that put the crossing's three links under one light with these phases."""
    programme = "".join(f'<phase duration="9" state="{state}"/>' for state in states)
    light = f'<tlLogic id="J" type="static" programID="0" offset="0">{programme}</tlLogic><junction id="J" '
    edits = [(f'via=":J_{k}_0"', f'via=":J_{k}_0" tl="J" linkIndex="{k}"') for k in range(3)]
    return [*edits, ('<junction id="J" type="priority"', light + 'type="traffic_light"')]


def test_lights_are_right_when_foes_never_have_green_together(tmp_path: Path) -> None:
    road = crossing()
    light = replace(road.regulations[0], kind="traffic_light", lanes=(5, 2, 8), yielding=(), priority=())
    lit = replace(road, regulations=(light,))
    mutual = ('<request index="0" response="000"', '<request index="0" response="100"')
    report = check_net(write_net(tmp_path, *with_light("GGr", "yyr", "rrG", "rry"), mutual), lit, Table())
    assert report.problems() == []
    assert report["signalled"] == 3
    # Links 0 and 2 both have a green that must look, and each yields to the other: nobody goes.
    report = check_net(write_net(tmp_path, *with_light("gGg", "yyy"), mutual), lit, Table())
    assert report["mutual_yields"] == ((":J_0_0", ":J_2_0"),)
    assert report["clashing_greens"] == ()
    report = check_net(write_net(tmp_path, *with_light("GrG")), lit, Table())
    assert report["clashing_greens"] == ((":J_0_0", ":J_2_0"),)


@pytest.mark.parametrize(
    ("text", "words"), [(None, "no such file"), ("no xml", "not XML"), ("<osm/>", "root element is <osm>")]
)
def test_what_is_no_net_is_refused(tmp_path: Path, text: str | None, words: str) -> None:
    path = tmp_path / "x.net.xml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        check_net(path, crossing())
