"""Crossings, walking areas and sidewalks: people walk on them in SUMO, and somebody gives way."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest

from scex_sumo import example_path, read_map
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.lanelet2sumo.reader import read_net
from scex_sumo.road import Lane, Regulation, Road
from tests.converters.sumo_roads import SUMO, NetFile, lane, load, road
from tests.lanelet2sumo.judge.driving import judged
from tests.lanelet2sumo.walkers import ROUNDABOUT_ARMS, contacts, crosswalk, with_lanes

EAST, WEST = lane(1, [(-100, -1.75), (100, -1.75)]), lane(2, [(100, 1.75), (-100, 1.75)])
CROSSWALK = (7, [(0, -5), (0, 5)])
SOUTH, NORTH = (8, [(0, -40), (0, -5)]), (9, [(0, 5), (0, 40)])


def footway(way: tuple[int, list[tuple[float, float]]], subtype: str = "walkway") -> Lane:
    """A lane for people."""
    return replace(lane(*way, width=3.0, kind="pedestrian"), subtype=subtype)


def street(*more: Lane, rules: Iterable[Regulation] = ()) -> Road:
    """A lane each way along x, and footways."""
    return road([EAST, WEST, *more], tuple(rules))


ZEBRA = footway(CROSSWALK, "crosswalk")
PAVEMENTS = (footway(SOUTH), footway(NORTH))


@pytest.fixture
def net(tmp_path: Path) -> Path:
    """A net with a crosswalk between two walkways."""
    return convert(street(ZEBRA, *PAVEMENTS), tmp_path / "net.net.xml").path


def walked(net: Path, walk: str, *, cars: int) -> tuple[dict[str, list[float]], list[tuple[float, float]]]:
    """Times at which a person was on each edge, and times and x of the cars between the kerbs."""
    flow = [f'<vehicle id="c{k}" depart="{2 * k}"><route edges="l1#0 l1#1"/></vehicle>' for k in range(cars)]
    person = f'<person id="p" depart="8"><walk edges="{walk}"/></person>'
    trips = "".join([*flow[:4], person, *flow[4:]])
    routes, fcd = net.with_name("r.rou.xml"), net.with_name("fcd.xml")
    routes.write_text(f'<routes><vType id="DEFAULT_VEHTYPE" sigma="0"/>{trips}</routes>')
    command = [SUMO, "-n", net, "-r", routes, "--fcd-output", fcd, "--step-length", "0.1", "--no-step-log"]
    command += ["--xml-validation", "never", "--end", "200"]
    subprocess.run(list(map(str, command)), check=True, capture_output=True, timeout=60)
    person_on: dict[str, list[float]] = defaultdict(list)
    under: list[tuple[float, float]] = []
    for step in ET.parse(fcd).getroot():
        time = float(step.get("time", ""))
        for one in step:
            if one.tag == "person":
                person_on[one.get("edge", "")].append(time)
            elif -1.5 < (x := float(one.get("x", ""))) < 6.5:  # a car of 5 m over the crosswalk
                under.append((time, x))
    return person_on, under


def test_a_crosswalk_is_a_crossing_between_walking_areas_and_loads_clean(net: Path) -> None:
    functions = {e.get("id"): e.get("function") for e in NetFile(net).root.iter("edge")}
    crossing, *areas = [i for i, function in functions.items() if function in ("crossing", "walkingarea")]
    assert (crossing, areas) == (":j1#1_c0", [":j1#1_w0", ":j1#1_w1"])
    assert {i for i in functions if functions[i] is None} == {"l1#0", "l1#1", "l2#0", "l2#1", "w8", "w9"}
    assert load(net) == ""


def test_cars_stop_for_a_person_on_a_crosswalk(net: Path) -> None:
    on, cars = walked(net, "w8 w9", cars=30)
    crossing = on[":j1#1_c0"]
    assert len(crossing) > 30  # 10 m at 1.4 m/s, in steps of 0.1 s
    south = [t for t in crossing if t < crossing[0] + 3.0]  # on the lane that the cars come along
    assert not [t for t, _ in cars if t in south]
    assert len({t for t, _ in cars}) > 100  # there is traffic before and after


def test_on_a_walkway_across_the_road_people_wait_for_cars(tmp_path: Path) -> None:
    """One walkway of 80 m: its stretch on the road is the crossing, a metre from the kerbs."""
    across = footway((7, [(0, -40), (0, 40)]))
    net = convert(street(across), tmp_path / "net.net.xml")
    assert net.lanes.sumo_lanes(7) == (":j1#1_c0_0", "w7#0_0", "w7#2_0")
    on, cars = walked(net.path, "w7#0 w7#2", cars=30)
    last_car = max(t for t, _ in cars)
    assert on[":j1#1_c0"][0] > last_car - 3.0
    requests = NetFile(net.path)
    assert (":j1#1_c0_0", ":j1#1_0_0") in requests.yields
    assert (":j1#1_0_0", ":j1#1_c0_0") not in requests.yields


def test_a_crosswalk_that_ends_before_the_middle_of_a_slanted_lane_goes_over_it(tmp_path: Path) -> None:
    """A lane passes .3 m beyond its end and clips a corner; SUMO sees people where lines cross."""
    slanted = lane(1, [(-60, -24.7), (60, 35.3)])
    net = convert(road([slanted, ZEBRA]), tmp_path / "net.net.xml").path
    lanes = read_net(net).lanes
    assert lanes[":j1#1_c0_0"].line.crosses(lanes[":j1#1_0_0"].line)
    assert (":j1#1_0_0", ":j1#1_c0_0") in NetFile(net).yields


def test_crosswalks_that_meet_on_an_island_are_two_crossings(tmp_path: Path) -> None:
    apart = lane(1, [(-100, -4.0), (100, -4.0)]), lane(2, [(100, 4.0), (-100, 4.0)])
    halves = footway((5, [(0, -7.25), (0, 0)]), "crosswalk"), footway((6, [(0, 0), (0, 7.25)]), "crosswalk")
    net = convert(road([*apart, *halves]), tmp_path / "net.net.xml")
    lanes = read_net(net.path).lanes
    assert sum(x.function == "crossing" for x in lanes.values()) == 2
    assert len({*net.lanes.sumo_lanes(5), *net.lanes.sumo_lanes(6)}) == 2
    on, _ = walked(net.path, "w5#0 w6#1", cars=0)
    assert len([edge for edge in on if "_c" in edge]) == 2


def test_a_walkway_is_cut_where_a_crosswalk_comes_in_from_the_side(tmp_path: Path) -> None:
    beside = footway((8, [(-40, -6.5), (40, -6.5)]))
    net = convert(street(ZEBRA, beside, footway(NORTH)), tmp_path / "net.net.xml")
    for side in ("w8#0", "w8#1"):
        on, _ = walked(net.path, f"{side} w9", cars=0)
        assert on[":j1#1_c0"]


def test_people_walk_while_the_lights_of_the_road_are_red(tmp_path: Path) -> None:
    """One light holds both lanes and would always be green: people get a phase of their own."""
    light = Regulation(element_id=50, kind="traffic_light", lanes=(1, 2), lights=(51,))
    ahead = lane(3, [(20, -1.75), (100, -1.75)]), lane(4, [(-20, 1.75), (-100, 1.75)])
    behind = lane(1, [(-100, -1.75), (20, -1.75)], to=(3,)), lane(2, [(100, 1.75), (-20, 1.75)], to=(4,))
    a_road = road([*behind, *ahead, ZEBRA, *PAVEMENTS], (light,))
    net = convert(a_road, tmp_path / "net.net.xml")
    assert load(net.path) == ""
    root = NetFile(net.path).root
    [to_crossing] = [c for c in root.iter("connection") if "_c0" in c.get("to", "")]
    place = int(to_crossing.get("linkIndex", ""))
    states = [phase.get("state", "") for phase in root.iter("phase")]
    assert any(state[place] == "G" for state in states)
    assert all(set(state[:place]) <= {"r"} for state in states if state[place] == "G")


def test_lane_changes_survive_a_crosswalk_over_the_whole_lanelet(tmp_path: Path) -> None:
    rows = [
        lane(2 * k + n, [(x, 3.5 * n), (y, 3.5 * n)], to=(2 * k + n + 2,) if k < 2 else (), **beside)
        for k, (x, y) in enumerate(((-60, -2), (-2, 2), (2, 60)))
        for n, beside in ((0, {"left": 2 * k + 1}), (1, {"right": 2 * k}))
    ]
    over = replace(lane(7, [(0, -5), (0, 9)], width=5.0, kind="pedestrian"), subtype="crosswalk")
    a_road = road([*rows, over])
    assert judged(a_road, tmp_path / "net.net.xml").problems() == []


def test_moving_cars_touch_nobody_on_crossings_of_arms(tmp_path: Path) -> None:
    """Crosswalks that end within the outer lanes of a roundabout's arms: 7 people were touched in 100 s."""
    arms = [crosswalk(90001 + k, a, 33.0, (-7.5, 7.5)) for k, a in enumerate(ROUNDABOUT_ARMS)]
    a_road = with_lanes(read_map(example_path("roundabout")), *arms)
    assert len(contacts(convert(a_road, tmp_path / "net.net.xml").path, end_s=100.0)) <= 1
