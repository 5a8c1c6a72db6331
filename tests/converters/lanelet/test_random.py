"""Maps damaged at random: a road that holds together or one clear error, never a crash of the process."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

from tests.command import script
from tests.converters.maps import DASHED, ROAD, Lanelet, Line, area, draw_map, rule, straight

MAPS = 150

# Reads the maps named on the command line and checks what any road must fulfil.
READ = """
import sys
import numpy as np
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.base.errors import ScexError

def check(road):
    lanes = road.lanes
    for lane_id, lane in lanes.items():
        assert lane.lane_id == lane_id
        for line in (lane.centreline, lane.left_bound, lane.right_bound):
            assert len(line) > 1 and np.isfinite(line).all()
        assert 0 < lane.speed_limit_mps < 100
        assert all(lane_id in lanes[other].predecessors for other in lane.successors)
        assert all(lane_id in lanes[other].successors for other in lane.predecessors)
        assert all(lane_id in lanes[other].conflicts and other != lane_id for other in lane.conflicts)
        for other in (lane.left, lane.right, lane.adjacent_left, lane.adjacent_right):
            assert other is None or lanes[other].kind == "vehicle"
        assert lane.kind == "vehicle" or not (lane.successors or lane.conflicts or lane.left)
    for regulation in road.regulations:
        assert {*regulation.lanes, *regulation.yielding, *regulation.priority} <= set(lanes)

roads = 0
for path in sys.argv[1:]:
    print(path, flush=True)
    try:
        check(read_road(path))
        roads += 1
    except ScexError as error:
        assert str(error).startswith(path) and len(str(error)) < 600 and "\\n" not in str(error), error
print("roads", roads)
"""


def intersection() -> ET.Element:
    """A map with everything in it: forks, crossings, lane changes, rules, an area, a two-way lanelet."""
    crosswalk = Lanelet(5, [(40, -5), (40, 12)], [(44, -5), (44, 12)], tags={"subtype": "crosswalk"})
    lanelets = [
        straight(1, 0, 50, left_tags=DASHED, rules=[90, 91]),
        straight(2, 0, 50, y=3.5, right_tags=DASHED, rules=[91]),
        straight(3, 50, 90),
        Lanelet(4, [(50, 3.5), (90, 23.5)], [(50, 0), (90, 20)], rules=[92]),
        crosswalk,
        Lanelet(6, [(70, -30), (70, 30)], [(74, -30), (74, 30)], tags={**ROAD, "one_way": "no"}, rules=[90]),
    ]
    lines = [
        Line(7, [(49, 0), (49, 3.5)]),
        Line(8, [(52, 9), (53, 9)], {"type": "traffic_sign", "subtype": "de205"}),
        Line(10, [(0, 20), (9, 20), (9, 29)]),
        Line(11, [(9, 29), (0, 29), (0, 20)]),
    ]
    relations = [
        rule(90, "right_of_way", [("yield", 1), ("right_of_way", 6), ("ref_line", 7), ("refers", 8)]),
        rule(91, "speed_limit", sign_type="30kmh"),
        rule(92, "traffic_light", [("refers", 8), ("ref_line", 7)]),
        area(60, [10, 11], "keepout"),
    ]
    return ET.fromstring(draw_map(lanelets, lines=lines, relations=relations).encode())


def remove(root: ET.Element, rng: random.Random) -> None:
    root.remove(rng.choice(list(root)))


def remove_part(root: ET.Element, rng: random.Random) -> None:
    element = rng.choice([e for e in root if len(e)] or [root])
    element.remove(rng.choice(list(element)))


def empty(root: ET.Element, rng: random.Random) -> None:
    element = rng.choice([e for e in root if e.tag == "way"] or [root])
    for part in list(element)[rng.randrange(2) :]:
        element.remove(part)


def repeat(root: ET.Element, rng: random.Random) -> None:
    root.append(copy.deepcopy(rng.choice(list(root))))


def change_id(root: ET.Element, rng: random.Random) -> None:
    other = rng.choice(list(root)).get("id", "")
    rng.choice(list(root)).set("id", rng.choice([other, "0", "-7", "one", "1e3", "9" * 30]))


def move(root: ET.Element, rng: random.Random) -> None:
    node = rng.choice([e for e in root if e.tag == "node"] or [root])
    value = rng.choice(["0", "1e-4", "-2e-4", "nan", "inf", "91", "45", "", "north"])
    node.set(rng.choice(["lat", "lon"]), value)


def change_member(root: ET.Element, rng: random.Random) -> None:
    members = [part for e in root for part in e if part.tag in ("member", "nd")]
    if members:
        value = rng.choice([rng.choice(list(root)).get("id", ""), "left", "right", "way", "relation", "0"])
        rng.choice(members).set(rng.choice(["ref", "role", "type"]), value)


def add_member(root: ET.Element, rng: random.Random) -> None:
    kind, ref = (lambda e: (e.tag, e.get("id", "")))(rng.choice(list(root)))
    role = rng.choice(["left", "right", "centerline", "outer", "refers", "yield", "regulatory_element"])
    relation = rng.choice([e for e in root if e.tag == "relation"] or [root])
    ET.SubElement(relation, "member", type=kind, ref=ref, role=role)


def add_tag(root: ET.Element, rng: random.Random) -> None:
    key = rng.choice(["type", "subtype", "area", "one_way", "speed_limit", "ele", "participant:vehicle"])
    value = rng.choice(
        ["yes", "no", "lanelet", "multipolygon", "regulatory_element", "right_of_way", "7", "nan"]
    )
    ET.SubElement(rng.choice(list(root)), "tag", k=key, v=value)


def write_damaged(folder: Path) -> list[Path]:
    """Maps with 1 to 12 random defects."""
    paths = []
    for seed in range(MAPS):
        rng = random.Random(seed)
        root = intersection()
        for _ in range(rng.choice([1, 2, 4, 12])):
            rng.choice(DAMAGE)(root, rng)
        paths.append(folder / f"{seed}.osm")
        paths[-1].write_bytes(ET.tostring(root))
    return paths


DAMAGE: list[Callable[[ET.Element, random.Random], None]] = [
    remove,
    remove_part,
    empty,
    repeat,
    change_id,
    move,
    change_member,
    add_member,
    add_tag,
]


def test_damaged_maps_give_a_sound_road_or_a_clear_error(tmp_path: Path) -> None:
    paths = write_damaged(tmp_path)
    done = script(READ, *paths)
    assert done.returncode == 0, f"exit {done.returncode} after {done.stdout[-200:]!r}: {done.stderr[-900:]}"
    # Damage is mostly light: reading most of the maps is part of the claim.
    assert int(done.stdout.rsplit(None, 1)[-1]) > 0.8 * MAPS
