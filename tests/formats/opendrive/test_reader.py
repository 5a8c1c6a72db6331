"""OpenDRIVE lanes have the borders, links, signals and sides of their file; what is wrong in it is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.converters.maps import read_map
from scex_sumo.exporters.opendrive.file import opendrive
from scex_sumo.geometry.polylines import distances, samples
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Road
from scex_sumo.scenarios import example_path
from tests.lanelet2sumo.judge.report import check_net


def stretch(x: float, y: float, heading: float, length: float, curve: str = "<line/>") -> str:
    return f'<geometry s="0" x="{x}" y="{y}" hdg="{heading}" length="{length}">{curve}</geometry>'


def road(
    number: int, geometry: str, *, link: str = "", lanes: tuple[int, ...] = (-1,), more: str = ""
) -> str:
    """Lanes of 3.5 m, those with positive numbers left of the reference line."""
    sides = ""
    for side, chosen in (("left", [k for k in lanes if k > 0]), ("right", [k for k in lanes if k < 0])):
        width = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
        inner = "".join(f'<lane id="{k}" type="driving">{width}</lane>' for k in chosen)
        sides += f"<{side}>{inner}</{side}>" if chosen else ""
    section = f'<laneSection s="0"><center><lane id="0" type="none"/></center>{sides}</laneSection>'
    return (
        f'<road id="{number}" length="50" junction="-1"><link>{link}</link><planView>{geometry}</planView>'
        f"<lanes>{section if lanes else ''}</lanes>{more}</road>"
    )


def written(folder: Path, *parts: str) -> Path:
    path = folder / "town.xodr"
    header = '<header revMajor="1" revMinor="7"/>'
    path.write_text(f'<?xml version="1.0"?><OpenDRIVE>{header}{"".join(parts)}</OpenDRIVE>')
    return path


def end(road: Road) -> tuple[float, float]:
    (lane,) = road.vehicle_lanes.values()
    x, y = lane.centreline[-1]
    return float(x), float(y)


STRAIGHT = 50.0, -1.75
BENT = 100 * np.sin(0.5) + 1.75 * np.sin(0.5), 100 * (1 - np.cos(0.5)) - 1.75 * np.cos(0.5)
# Its heading is s²/5000: Fresnel's integrals, from the right to the middle of the lane.
TURNED = (np.arange(50_000) + 0.5) ** 2 / 5e9
SPIRAL = np.cos(TURNED).sum() / 1e3 + 1.75 * np.sin(0.5), np.sin(TURNED).sum() / 1e3 - 1.75 * np.cos(0.5)


@pytest.mark.parametrize(
    ("curve", "place"),
    [
        ('<arc curvature="0"/>', STRAIGHT),
        ('<spiral curvStart="0" curvEnd="0"/>', STRAIGHT),
        ('<spiral curvStart="0.01" curvEnd="0.01"/>', BENT),
        ('<spiral curvStart="0.01" curvEnd="0.01000000000001"/>', BENT),
        ('<spiral curvStart="0" curvEnd="0.02"/>', SPIRAL),
        ('<arc curvature="1e-13"/>', STRAIGHT),
        ('<poly3 a="0" b="0" c="0" d="0"/>', STRAIGHT),
        ('<paramPoly3 pRange="arcLength" aU="0" bU="1" aV="0" bV="0"/>', STRAIGHT),
    ],
)
def test_a_lane_follows_the_reference_line(curve: str, place: tuple[float, float], tmp_path: Path) -> None:
    read = read_map(written(tmp_path, road(1, stretch(0, 0, 0, 50, curve))))
    assert end(read) == pytest.approx(place, abs=0.001)


@pytest.mark.parametrize(
    ("geometry", "said"),
    [
        (stretch(float("nan"), 0, 0, 50), "road 1: x of its geometry is 'nan'"),
        (stretch(0, 0, 0, 50, '<arc curvature="x"/>'), "road 1: curvature of its arc is 'x'"),
        (stretch(0, 0, 0, 1e12), r"road 1: length of its geometry is 1e\+12 m"),
        (stretch(0, 0, 0, 50, '<paramPoly3 bU="1e308" cU="-1e308" dU="1e308"/>'), "road 1: cannot convert"),
        ("", "none of its 1 roads has geometry and lanes"),
    ],
)
def test_what_cannot_be_repaired_is_named(geometry: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(MapError, match=said):
        read_map(written(tmp_path, road(1, geometry)))


def to_junction(tag: str) -> str:
    return f'<{tag} elementType="junction" elementId="10"/>'


def direct(*connections: tuple[int, int, str, int, int]) -> str:
    """Direct junction of (incoming road, linked road, contact point, lane from, lane to)."""
    inner = "".join(
        f'<connection id="{k}" incomingRoad="{a}" linkedRoad="{b}" contactPoint="{contact}">'
        f'<laneLink from="{here}" to="{there}"/></connection>'
        for k, (a, b, contact, here, there) in enumerate(connections)
    )
    return f'<junction id="10" name="" type="direct">{inner}</junction>'


def ways(read: Road) -> set[tuple[tuple[int, int], ...]]:
    """Places, in tens of metres, along each way from a lane without predecessor to one without successor."""

    def at(lane: int, k: int) -> tuple[int, int]:
        x, y = read.lanes[lane].centreline[k]
        return round(x / 10), round(y / 10)

    def onward(lane: int) -> list[list[int]]:
        after = read.lanes[lane].successors
        return [[lane, *rest] for i in after for rest in onward(i)] or [[lane]]

    begins = [i for i, lane in read.vehicle_lanes.items() if not lane.predecessors]
    return {(at(way[0], 0), at(way[-1], -1)) for i in begins for way in onward(i)}


def test_an_exit_by_a_direct_junction_is_linked(tmp_path: Path) -> None:
    parts = (
        road(1, stretch(0, 0, 0, 50), link=to_junction("successor"), lanes=(-1, -2)),
        road(2, stretch(50, 0, 0, 50), link=to_junction("predecessor")),
        road(3, stretch(50, -3.5, -0.4, 50), link=to_junction("predecessor")),
        direct((1, 2, "start", -1, -1), (1, 3, "start", -2, -1)),
    )
    read = read_map(written(tmp_path, *parts))
    assert ways(read) == {((0, 0), (10, 0)), ((0, -1), (10, -2))}


@pytest.mark.parametrize(
    "curve",
    [
        '<arc curvature="0.01"/>',
        '<spiral curvStart="0.009999" curvEnd="0.010001"/>',
        '<paramPoly3 pRange="normalized" aU="0" bU="50" cU="0" dU="-2.06" aV="0" bV="0" cV="12.7" '
        'dV="-0.46"/>',
    ],
)
def test_a_direct_junction_lies_where_the_curve_before_it_ends(curve: str, tmp_path: Path) -> None:
    x, y = 100 * np.sin(0.5), 100 * (1 - np.cos(0.5))
    parts = (
        road(1, stretch(0, 0, 0, 50, curve), link=to_junction("successor")),
        road(2, stretch(x, y, 0.5, 50), link=to_junction("predecessor")),
        direct((1, 2, "start", -1, -1)),
    )
    assert ways(read_map(written(tmp_path, *parts))) == {((0, 0), (9, 3))}


def test_an_entry_and_oncoming_traffic_by_a_direct_junction_are_linked(tmp_path: Path) -> None:
    """Road 1 leads both ways; road 3 is driven against its reference line, and enters road 1."""
    parts = (
        road(1, stretch(0, 0, 0, 50), link=to_junction("successor"), lanes=(2, 1, -1)),
        road(2, stretch(50, 0, 0, 50), link=to_junction("predecessor"), lanes=(1, -1)),
        road(3, stretch(50, 3.5, 0.4, 50), link=to_junction("predecessor"), lanes=(1,)),
        direct((1, 2, "start", -1, -1), (1, 2, "start", 1, 1), (1, 3, "start", 2, 1)),
    )
    assert ways(read_map(written(tmp_path, *parts))) == {
        ((0, 0), (10, 0)),
        ((10, 0), (0, 0)),
        ((10, 2), (0, 1)),
    }


def lane_of(number: int, widths: str, more: str = "") -> str:
    return f'<lane id="{number}" type="driving">{widths}{more}</lane>'


def width(s: float, a: float, c: float = 0.0, d: float = 0.0) -> str:
    return f'<width sOffset="{s}" a="{a}" b="0" c="{c}" d="{d}"/>'


def plain_road(number: str, sections: str, *, attributes: str = "", more: str = "") -> str:
    """A road of 200 m along the x axis with any lane sections."""
    line = stretch(0, 0, 0, 200)
    return (
        f'<road id="{number}" length="200" junction="-1" {attributes}>{more}<planView>{line}</planView>'
        f"<lanes>{sections}</lanes></road>"
    )


def section(s: float, right: str = "", left: str = "", centre: str = '<lane id="0" type="none"/>') -> str:
    parts = (("left", left), ("center", centre), ("right", right))
    inner = "".join(f"<{side}>{lanes}</{side}>" for side, lanes in parts if lanes)
    return f'<laneSection s="{s}">{inner}</laneSection>'


def test_beside_a_lane_that_opens_the_others_keep_their_centres(tmp_path: Path) -> None:
    """Lane -1 opens from 50 to 100 m and pushes lane -2 outwards."""
    opening = width(0, 0) + width(50, 0, 0.0042, -5.6e-5) + width(100, 3.5)
    lanes = lane_of(-1, opening) + lane_of(-2, width(0, 3.5))
    read = read_map(written(tmp_path, plain_road("1", section(0, lanes))))
    outer, both, opened = read.lanes.values()
    assert outer.successors == (both.lane_id,) and not opened.predecessors
    assert (opened.right, both.left) == (both.lane_id, opened.lane_id)
    points = samples(np.vstack([outer.centreline, both.centreline]), 0.5)[1]
    u = np.clip(points[:, 0] - 50.0, 0.0, 50.0)
    np.testing.assert_allclose(points[:, 1], -1.75 - 0.0042 * u**2 + 5.6e-5 * u**3, atol=0.003)
    assert opened.centreline[0, 0] == pytest.approx(67.5, abs=1.5)  # where it is a metre wide
    net = convert(read, tmp_path / "opens.net.xml")
    assert check_net(net.path, read, net.lanes).problems() == []


def test_a_section_that_begins_beyond_the_end_of_its_road_is_not_there(tmp_path: Path) -> None:
    lane = lane_of(-1, width(0, 3.5))
    late = plain_road("1", section(0, lane) + section(9000, lane))
    assert end(read_map(written(tmp_path, late)))[1] == pytest.approx(-1.75)


def test_lanes_of_sections_follow_by_their_links(tmp_path: Path) -> None:
    link = '<link><predecessor id="{}"/></link>'
    first = section(0, lane_of(-1, width(0, 3.5)) + lane_of(-2, width(0, 3.5)))
    second = section(100, lane_of(-1, width(0, 3.5), link.format(-2)))
    read = read_map(written(tmp_path, plain_road("1", first + second)))
    (after,) = [lane for lane in read.lanes.values() if lane.predecessors]
    assert read.lanes[after.predecessors[0]].centreline[0, 1] == pytest.approx(-5.25)


@pytest.mark.parametrize(
    ("mark", "free"),
    [
        ("broken", True),
        ("solid", False),
        ("none", True),
        ('solid" laneChange="both', True),
        ('broken" laneChange="none', False),
    ],
)
def test_markings_forbid_lane_changes(mark: str, free: bool, tmp_path: Path) -> None:
    line = f'<roadMark sOffset="0" type="{mark}"/>'
    lanes = lane_of(-1, width(0, 3.5), line) + lane_of(-2, width(0, 3.5))
    read = read_map(written(tmp_path, plain_road("1", section(0, lanes))))
    outer, inner = read.lanes.values()
    assert (outer.adjacent_left, inner.adjacent_right) == (inner.lane_id, outer.lane_id)
    assert (outer.left is not None, inner.right is not None) == (free, free)


def test_limits_are_those_of_the_lane_else_of_the_road(tmp_path: Path) -> None:
    kind = '<type s="0" type="rural"><speed max="70" unit="km/h"/></type>'
    lanes = lane_of(-1, width(0, 3.5)) + lane_of(-2, width(0, 3.5), '<speed sOffset="0" max="10"/>')
    read = read_map(written(tmp_path, plain_road("1", section(0, lanes), more=kind)))
    outer, inner = read.lanes.values()
    assert (outer.speed_limit_mps, inner.speed_limit_mps) == (10.0, pytest.approx(70 / 3.6))
    assert outer.location == "nonurban"


def test_signals_hold_the_lanes_for_which_they_are_valid(tmp_path: Path) -> None:
    light = '<signal id="7" s="190" t="-4" type="1000001" dynamic="yes" orientation="+"/>'
    sign = (
        '<signal id="8" s="10" t="4" type="206" orientation="-"><validity fromLane="1" toLane="1"/></signal>'
    )
    both = section(0, lane_of(-1, width(0, 3.5)), lane_of(1, width(0, 3.5)))
    text = plain_road("1", both).replace("</road>", f"<signals>{light}{sign}</signals></road>")
    read = read_map(written(tmp_path, text))
    right, left = read.lanes.values()
    stop, lit = read.regulations
    assert (stop.kind, stop.lanes, stop.yielding) == ("stop", (left.lane_id,), (left.lane_id,))
    assert (lit.kind, lit.lanes) == ("traffic_light", (right.lane_id,))
    np.testing.assert_allclose(lit.stop_lines[0][:, 0], 190.0, atol=1.0)


@pytest.mark.parametrize("name", ["motorway_merge", "urban_intersection"])
def test_opendrive_of_this_project_comes_back_within_a_centimetre(name: str, tmp_path: Path) -> None:
    drawn = read_map(example_path(name))
    (tmp_path / "own.xodr").write_text(opendrive(drawn).text)
    back = read_map(tmp_path / "own.xodr")
    lines = [lane.centreline for lane in back.vehicle_lanes.values()]
    for lane in drawn.vehicle_lanes.values():
        points = samples(lane.centreline, 1.0)[1]
        near = np.min([distances(points, line) for line in lines], axis=0)
        assert np.quantile(near, 0.9) < 0.01
    kinds = [{rule.kind for rule in one.regulations} for one in (drawn, back)]
    assert kinds[0] & {"traffic_light", "right_of_way"} == kinds[1] & {"traffic_light", "right_of_way"}


@pytest.mark.parametrize(("rule", "eastwards"), [("RHT", -1.75), ("LHT", 1.75)])
def test_lanes_are_driven_on_the_side_of_the_road_s_rule(rule: str, eastwards: float, tmp_path: Path) -> None:
    lanes = section(0, lane_of(-1, width(0, 3.5)), lane_of(1, width(0, 3.5)))
    read = read_map(written(tmp_path, plain_road("1", lanes, attributes=f'rule="{rule}"')))
    assert read.left_hand is (rule == "LHT")
    (east,) = [lane for lane in read.lanes.values() if lane.centreline[0, 0] < lane.centreline[-1, 0]]
    np.testing.assert_allclose(east.centreline[:, 1], eastwards)
    assert east.left_bound[0, 1] > east.right_bound[0, 1]
    net = convert(read, tmp_path / "side.net.xml")
    assert check_net(net.path, read, net.lanes).problems() == []
