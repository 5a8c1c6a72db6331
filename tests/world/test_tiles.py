"""Tiles are copies: ids prefixed, coordinates moved by whole metres, nothing else touched."""

from __future__ import annotations

import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from scex_sumo.base.errors import SimulationError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.world.tiles import TILE_SLOTS, TileLayout, TileTemplate, tile_id

NET = """<?xml version="1.0" encoding="UTF-8"?>
<net version="1.20" junctionCornerDetail="5" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/net_file.xsd">
    <location netOffset="0.00,0.00" convBoundary="0,0,100,5" origBoundary="0,0,100,5" projParameter="!"/>
    <type id="road" priority="1"/>
    <edge id=":b_0" function="internal">
        <lane id=":b_0_0" index="0" speed="13.9" length="10.00" shape="50.00,0.10 60.00,0.1,7.5"/>
    </edge>
    <edge id="first" from="a" to="b" priority="-1">
        <lane id="first_0" index="0" allow="bus taxi" speed="13.9" length="50.00"
            shape="-0.30,0.125 50.00,0.10">
            <param key="origId" value="first"/>
        </lane>
    </edge>
    <edge id="second" from="b" to="c" priority="-1">
        <lane id="second_0" index="0" speed="13.9" length="40" shape="60.00,0.10 100.00,4.90"/>
    </edge>
    <tlLogic id="b" type="static" programID="0" offset="0"><phase duration="30" state="G"/></tlLogic>
    <junction id="b" type="priority" x="55.00" y="0.00" incLanes="first_0" intLanes=":b_0_0"
        shape="50,1 60,1">
        <request index="0" response="0" foes="0" cont="0"/>
    </junction>
    <connection from="first" to="second" fromLane="0" toLane="0" via=":b_0_0" tl="b" linkIndex="0" dir="s"/>
    <connection from=":b_0" to="second" fromLane="0" toLane="0" dir="s"/>
    <roundabout nodes="a b" edges="first second"/>
</net>
"""


@pytest.fixture
def template(tmp_path: Path) -> TileTemplate:
    path = tmp_path / "map.net.xml"
    path.write_text(NET, encoding="utf-8")
    return TileTemplate(path)


def copies(template: TileTemplate, folder: Path, slots: list[int], layout: TileLayout) -> ElementTree.Element:
    template.write(folder / "tiles.net.xml", slots, layout)
    return ElementTree.parse(folder / "tiles.net.xml").getroot()


def test_ids_are_prefixed_and_internal_ones_keep_their_colon(template: TileTemplate, tmp_path: Path) -> None:
    net = copies(template, tmp_path, [12], TileLayout(pitch_x=1000, pitch_y=1000))
    assert [e.get("id") for e in net.iter("edge")] == [":t12_b_0", "t12_first", "t12_second"]
    assert [e.get("id") for e in net.iter("lane")] == [":t12_b_0_0", "t12_first_0", "t12_second_0"]
    inner, outer = net.iter("connection")
    links = ("from", "to", "via", "tl")
    assert [inner.get(k) for k in links] == ["t12_first", "t12_second", ":t12_b_0_0", "t12_b"]
    assert [outer.get(k) for k in links] == [":t12_b_0", "t12_second", None, None]
    junction, light, ring = net.find("junction"), net.find("tlLogic"), net.find("roundabout")
    assert junction is not None and light is not None and ring is not None
    assert [junction.get(k) for k in ("id", "incLanes", "intLanes")] == ["t12_b", "t12_first_0", ":t12_b_0_0"]
    assert light.get("id") == "t12_b"
    assert (ring.get("nodes"), ring.get("edges")) == ("t12_a t12_b", "t12_first t12_second")
    assert tile_id(12, ":b_0") == ":t12_b_0" and tile_id(12, "first") == "t12_first"


def test_coordinates_move_by_whole_metres_to_the_last_decimal(template: TileTemplate, tmp_path: Path) -> None:
    net = copies(template, tmp_path, [9], TileLayout(pitch_x=1000, pitch_y=700))  # column 1, row 1
    shapes = {e.get("id"): e.get("shape") for e in net.iter("lane")}
    assert shapes["t9_first_0"] == "999.70,700.125 1050.00,700.10"
    assert shapes[":t9_b_0_0"] == "1050.00,700.10 1060.00,700.1,7.5"  # the height stays
    junction = net.find("junction")
    assert junction is not None
    assert [junction.get(k) for k in ("x", "y", "shape")] == ["1055.00", "700.00", "1050,701 1060,701"]


def test_a_slots_copy_is_the_same_text_whichever_others_are_written(
    template: TileTemplate, tmp_path: Path
) -> None:
    layout = template.layout()

    def text_of_tile_7(slots: list[int]) -> list[str]:
        net = copies(template, tmp_path, slots, layout)
        return [ElementTree.tostring(e, encoding="unicode") for e in net if "t7_" in str(e.attrib)]

    assert text_of_tile_7([7]) == text_of_tile_7(list(range(TILE_SLOTS))) == text_of_tile_7([63, 7, 1])
    assert len(text_of_tile_7([7])) == 8


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<net><taz id='x'/></net>", "<taz> cannot be copied"),
        ("<net>", "cannot be read"),
        ("<net/>", "holds no lanes"),
    ],
)
def test_what_cannot_be_copied_is_an_error(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.net.xml"
    path.write_text(text)
    with pytest.raises(SimulationError, match=words):
        TileTemplate(path).layout()


LOGIC = """    <prohibition prohibitor="first-&gt;second" prohibited="second-&gt;first"/>
    <tlLogic id="b" type="actuated" programID="0" offset="0">
        <phase duration="30" minDur="5" maxDur="50" state="G" earlyTarget="Busy"/>
        <phase duration="3" state="r"/>
        <condition id="Busy" value="z:loop > 3"/>
        <assignment id="Count" check="z:loop" value="Count + 1"/>
        <function id="Twice" nArgs="1"><assignment id="Twice" check="1" value="$1 * 2"/></function>
    </tlLogic>"""


def test_logic_of_lights_and_prohibitions_are_left_out_and_the_copies_load(tmp_path: Path) -> None:
    start, end = NET.index("    <tlLogic"), NET.index("    <junction")
    path = tmp_path / "map.net.xml"
    path.write_text(NET[:start] + LOGIC + NET[end:], encoding="utf-8")
    net = copies(TileTemplate(path), tmp_path, [0, 3], TileLayout(pitch_x=1000, pitch_y=1000))
    assert {e.tag for e in net.iter()}.isdisjoint({"prohibition", "condition", "assignment", "function"})
    assert [light.get("id") for light in net.iter("tlLogic")] == ["t0_b", "t3_b"]
    assert not any("earlyTarget" in phase.attrib for phase in net.iter("phase"))
    command = [program("sumo"), "-n", "tiles.net.xml", "--end", "5", "--no-step-log"]
    done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True)
    assert "condition" not in done.stderr and "Busy" not in done.stderr
