"""What sumo-gui draws besides the net."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np

from scex_sumo.lanelet2sumo.drawing import extras_text
from scex_sumo.road import Marking, Regulation
from tests.converters.sumo_roads import lane, road

LINE = np.array([(0.0, 2.0), (60.0, 2.0)])
STOP = np.array([(58.0, -2.0), (58.0, 2.0)])
BASE = road([lane(1, [(0, 0), (60, 0)])])


def polygons(*, markings: tuple[Marking, ...] = (), **more: object) -> list[ET.Element]:
    """The polygons of the lane above with something beside it."""
    drawn = replace(BASE, markings=markings, **more)  # type: ignore[arg-type]
    return list(ET.fromstring(extras_text(drawn).encode()).iter("poly"))


def test_a_dashed_line_begins_and_ends_with_a_dash() -> None:
    dashes = polygons(markings=(Marking(line_id=5, kind="line_thin", subtype="dashed", points=LINE),))
    # 21 equal strokes and gaps on 60 m, so 11 dashes.
    assert len(dashes) == 11
    assert dashes[0].get("shape", "").startswith("0.000,2.000")
    assert dashes[-1].get("shape", "").endswith("60.000,2.000")


def test_a_stop_line_of_a_rule_is_drawn_once() -> None:
    rules = (
        Regulation(element_id=8, kind="traffic_light", lanes=(1,), stop_lines=(STOP,)),
        Regulation(element_id=9, kind="right_of_way", lanes=(1,), stop_lines=(STOP,)),
    )
    assert [p.get("type") for p in polygons(regulations=rules)] == ["stop_line"]
    marked = (Marking(line_id=4, kind="stop_line", subtype="", points=STOP),)
    assert len(polygons(markings=marked, regulations=rules)) == 1
