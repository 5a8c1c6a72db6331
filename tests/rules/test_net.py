"""Rules of a SUMO net: right of way, lights over time, and what contradicts itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.extrapolation.job import has_rules
from scex_sumo.geometry.bounds import bend
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.road import Area, Road
from scex_sumo.roads.mirror import mirrored_road
from scex_sumo.rules.apparent import turns_that_wait
from scex_sumo.rules.links import Link
from scex_sumo.rules.net import read_rules, with_rules
from tests.behaviors.roads import scene_of, straight
from tests.converters.maps import write_map
from tests.lanelet2sumo.judge.adversarial import intersection

# A street from a to b, and one from c to d that crosses it and gives way.
NET = """<net>
  <edge id=":j_0" function="internal"><lane id=":j_0_0" shape="0,0 10,0"/></edge>
  <edge id=":j_1" function="internal"><lane id=":j_1_0" shape="5,-5 5,5"/></edge>
  <edge id="a"><lane id="a_0" shape="-50,0 0,0"/></edge><edge id="b"><lane id="b_0" shape="10,0 50,0"/></edge>
  <edge id="c"><lane id="c_0" shape="5,-50 5,-5"/></edge><edge id="d"><lane id="d_0" shape="5,5 5,50"/></edge>
  LOGIC
  <junction id="j" type="priority" incLanes="a_0 c_0" intLanes=":j_0_0 :j_1_0" shape="0,0">
    <request index="0" response="FIRST" foes="10"/><request index="1" response="01" foes="01"/>
  </junction>
  <connection from="a" to="b" fromLane="0" toLane="0" via=":j_0_0" LIGHT state="M"/>
  <connection from="c" to="d" fromLane="0" toLane="0" via=":j_1_0" state="m"/>
</net>"""
LINK = {"lanes": ("a_0",), "junction": "j", "row": 0, "state": "M", "light": None}
LANES = LaneTable([(1, "a_0"), (2, ":j_0_0"), (3, "b_0"), (11, "c_0"), (12, ":j_1_0"), (13, "d_0")])
LOGIC = """<tlLogic id="t" programID="PROGRAMME" offset="OFFSET">
  <phase duration="20" state="G"/><phase duration="3" state="y"/><phase duration="30" state="r"/></tlLogic>"""


def rules_of(*, net: bool = True, phases: bool = True, **words: str):
    text = NET.replace("LOGIC", LOGIC if "LIGHT" in words else "")
    for word, value in ({"FIRST": "00", "LIGHT": "", "OFFSET": "0.1", "PROGRAMME": "0"} | words).items():
        text = text.replace(word, value)
    road = Road(name="drawn", lanes={}, net=__file__ if net else None, phases=phases)  # type: ignore[arg-type]
    rules = read_rules(ElementTree.fromstring(text), LANES, road)
    return rules, rules.notes


def test_passages_with_their_lanes_and_priority() -> None:
    rules, notes = rules_of()
    first, second = rules.passages
    assert (first.lanes, first.yields_to, first.state, first.signal) == ((1, 2, 3), (), "M", -1)
    assert (second.lanes, second.yields_to, second.state) == ((11, 12, 13), (0,), "m")
    assert first.line.tolist() == [[0, 0], [10, 0]]
    assert notes == ()


def test_phases_that_netconvert_invents_for_another_map_are_unknown() -> None:
    rules, _ = rules_of(phases=False, LIGHT='tl="t" linkIndex="0"')
    assert rules.signals[0].at(0.0)[0] == ""


def test_of_several_programmes_of_a_light_the_last_one_counts_as_in_sumo() -> None:
    night = '<tlLogic id="t" programID="night" offset="0"><phase duration="9" state="r"/></tlLogic>'
    rules, _ = rules_of(**{"LIGHT": 'tl="t" linkIndex="0"', "</tlLogic>": f"</tlLogic>{night}"})
    assert rules.signals[0].at(0.0)[0] == "r"


def test_crosswalks_of_a_map_without_regulations_count_if_there_are_people(tmp_path: Path) -> None:
    walk = Area(area_id=1, kind="crosswalk", outline=np.array([(40.0, -3.0), (43.0, -3.0), (43.0, 3.0)]))
    road = replace(straight(), areas=(walk,))
    scene = replace(scene_of((20.0, 0.0, 0.0, 9.0)), road=road)
    assert not has_rules(scene)
    with_people = replace(scene, people=np.zeros(1, dtype=bool))
    assert has_rules(with_people)
    ruled, _ = with_rules(with_people, converted(road, tmp_path / "x.net.xml"))
    assert ruled.rules is not None
    assert (len(ruled.rules.passages), len(ruled.rules.crosswalks)) == (0, 1)


def test_runs_of_one_moment_share_its_scene_with_rules(tmp_path: Path) -> None:
    scene = scex.read_seed(scex.example_path("roundabout"))
    assert scene.road is not None
    first, second = (converted(scene.road, tmp_path / f"{name}.net.xml") for name in "ab")
    ruled, notes = with_rules(scene, first)
    assert ruled is not scene
    assert with_rules(scene, second) == (ruled, notes)
    assert with_rules(ruled, second) == (ruled, notes)  # the reference of the run
    second.path.write_text(second.path.read_text().replace('state="m"', 'state="s"'))
    assert with_rules(ruled, second)[0] is not ruled


@pytest.mark.parametrize("left_hand", [False, True])
def test_where_a_map_says_nothing_a_turn_across_oncoming_traffic_waits(
    left_hand: bool, tmp_path: Path
) -> None:
    drawn = intersection()
    road = read_road(
        write_map(tmp_path / "m.osm", drawn.lanelets, lines=drawn.lines, relations=drawn.relations)
    )
    road = mirrored_road(road) if left_hand else road
    scene = replace(scene_of((40.0, 3.0, np.pi, 9.0)), road=road)
    assert has_rules(scene)
    rules = with_rules(scene, converted(road, tmp_path / "m.net.xml"))[0].rules
    assert rules is not None
    turns = [passage for passage in rules.passages if passage.yields_to]
    assert len(rules.passages) == 12 and len(turns) == 4
    (link,) = turns_that_wait([Link(**LINK, line=np.array([(0.0, 0), (9, 0)]), yields=frozenset({5}))])
    assert link.yields == frozenset()  # row 5 is a crosswalk
    for turn in turns:
        (oncoming,) = (rules.passages[k].line for k in turn.yields_to)
        assert bend(turn.line) * (-1 if left_hand else 1) > 1.0
        assert abs(bend(oncoming)) < 0.1
        assert (turn.line[1] - turn.line[0]) @ (oncoming[1] - oncoming[0]) < 0
