"""OpenDRIVE at which netconvert fails is repaired before, or refused in words about the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import MapError
from scex_sumo.converters.maps import read_map
from scex_sumo.road import Road


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


@pytest.mark.parametrize(
    ("curve", "place"),
    [
        ('<arc curvature="0"/>', STRAIGHT),
        ('<spiral curvStart="0" curvEnd="0"/>', STRAIGHT),
        ('<spiral curvStart="0.01" curvEnd="0.01"/>', BENT),
        ('<spiral curvStart="0.01" curvEnd="0.01000000000001"/>', BENT),
        ('<arc curvature="1e-13"/>', STRAIGHT),
    ],
)
def test_curves_that_do_not_bend_more_are_plain_ones(
    curve: str, place: tuple[float, float], tmp_path: Path
) -> None:
    read = read_map(written(tmp_path, road(1, stretch(0, 0, 0, 50, curve))))
    assert end(read) == pytest.approx(place, abs=0.02)
    assert any("spirals that are arcs or lines: roads 1" in note for note in read.notes)


@pytest.mark.parametrize(
    ("geometry", "said"),
    [
        (stretch(float("nan"), 0, 0, 50), "road 1: x of its geometry is 'nan'"),
        (stretch(0, 0, 0, 50, '<arc curvature="x"/>'), "road 1: curvature of its arc is 'x'"),
        (stretch(0, 0, 0, 1e12), r"road 1: length of its geometry is '1000000000000\.0'"),
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
    assert "direct junctions made ordinary ones: 10" in read.notes


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
