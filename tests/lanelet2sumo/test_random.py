"""Nets of random roads: crossings, roundabouts, forks and merges, rows of lanes."""

from __future__ import annotations

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from scex_sumo.base.arrays import FloatArray
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.road import Lane, Road
from tests.converters.sumo_roads import NetFile, arc, lane, load, road
from tests.lanelet2sumo.judge.report import check_net

# Without shrinking, which would take minutes here; the examples are the same every time.
PHASES = [Phase.explicit, Phase.generate]
LIMITED = settings(max_examples=8, derandomize=True, database=None, phases=PHASES)


def bent(start: tuple[float, float], angle: float, size: float, bend: float) -> FloatArray:
    """A curve of a given length that begins at a point and heading and turns by ``bend`` on the way, rad."""
    steps = 20
    headings = angle + bend * (np.arange(steps) + 0.5) / steps
    moves = size / steps * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.vstack([[start], start + np.cumsum(moves, axis=0)])


def check(drawn: Road) -> NetFile:
    """Everything that holds for any net."""
    with tempfile.TemporaryDirectory() as folder:
        net = convert(drawn, Path(folder) / "random.net.xml")
        assert load(net.path) == ""
        problems = check_net(net.path, drawn, net.lanes).problems()
        file = NetFile(net.path)
    assert problems == []
    assert file.foes == {pair[::-1] for pair in file.foes}
    assert file.yields <= file.foes
    states = {via: c.get("state") for via, c in file.connections.items()}
    for one, other in file.yields:
        assert (other, one) not in file.yields or states[one] == states[other] == "Z"
    driven = set()
    for via, c in file.connections.items():
        ends = [f"{c.get(e)}_{c.get(f'{e}Lane')}" for e in ("from", "to")]
        chain = [i for name in (ends[0], via, ends[1]) for i in net.lanes.lanelets(name)]
        driven |= {pair for pair in pairwise(chain) if pair[0] != pair[1]}
    assert driven == {(i, j) for i, one in drawn.vehicle_lanes.items() for j in one.successors}
    for i, one in drawn.vehicle_lanes.items():
        line = LineString(one.centreline)
        own = [LineString(file.shapes[name]) for name in net.lanes.sumo_lanes(i)]
        for s in np.arange(0.0, line.length, 0.5):
            assert min(Point(line.interpolate(s)).distance(shape) for shape in own) <= 0.1
    return file


@pytest.mark.parametrize("number", range(8))
def test_roads_that_cross_anyhow(number: int) -> None:
    rng, lanes = np.random.default_rng(number), []
    roads = rng.uniform([0.0, -15, -0.6, 2.6], [np.pi, 15, 0.6, 4.5], (2 + number % 4, 4)).tolist()
    for k, (angle, offset, bend, width) in enumerate(roads):
        # Roads pass the origin at some distance, at least 20 degrees apart from one another in heading.
        direction = angle / len(roads) * 0.8 + k * np.pi / len(roads)
        along = np.array([np.cos(direction), np.sin(direction)])
        begin = -60 * along + offset * np.array([-along[1], along[0]])
        lanes.append(lane(k + 1, bent((begin[0], begin[1]), direction, 120.0, bend), width=width))
    drawn = road(lanes)
    file = check(drawn)
    crossing = {
        (i, j)
        for i, one in drawn.lanes.items()
        for j, other in drawn.lanes.items()
        if i < j and LineString(one.centreline).crosses(LineString(other.centreline))
    }
    by_lane = {
        via: int(c.get("from", "").removeprefix("l").split("#")[0]) for via, c in file.connections.items()
    }
    assert crossing <= {(by_lane[a], by_lane[b]) for a, b in file.foes}


@LIMITED
@given(st.integers(3, 4), st.floats(19, 30), st.floats(3.0, 4.5), st.floats(0.5, 0.65), st.floats(15, 60))
def test_roundabouts(arms: int, radius: float, width: float, share: float, reach: float) -> None:
    check(roundabout(arms, radius, width, share, reach))


def roundabout(arms: int, radius: float, width: float, share: float, reach: float) -> Road:
    """Every arm leaves the ring at its first half and joins it at its second."""
    sector = 360.0 / arms
    lanes: list[Lane] = []
    for k in range(arms):
        a, b, c = sector * k, sector * (k + share), sector * (k + 1)
        lanes.append(lane(100 + k, arc((0, 0), radius, a, b), to=(200 + k,), width=width))
        lanes.append(
            lane(
                200 + k,
                arc((0, 0), radius, b, c),
                to=(100 + (k + 1) % arms, 300 + (k + 1) % arms),
                width=width,
            )
        )
        tip, heading = radius * _unit(a), np.radians(a + 90)
        lanes.append(lane(300 + k, _arm(tip, heading, reach, -1.3), width=width))
        # Driven backwards from where it joins, an entry is an exit of the mirrored ring.
        tip, heading = radius * _unit(b), np.radians(b - 90)
        line = _arm(tip, heading, reach, 1.3)[::-1]
        lanes.append(lane(400 + k, line, to=(200 + k,), width=width))
    return road(lanes)


def _arm(tip: FloatArray, heading: float, reach: float, bend: float) -> FloatArray:
    """Off the ring within 8 m, then straight: exits and entries of an arm do not cross."""
    turned = bent((tip[0], tip[1]), heading, 8.0, bend)
    return np.vstack([turned, turned[-1] + reach * _unit(np.degrees(heading + bend))])


def _unit(degrees: float) -> FloatArray:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


@LIMITED
@given(
    st.lists(st.floats(-0.9, 0.9), min_size=2, max_size=3, unique_by=lambda x: round(x, 1)),
    st.lists(st.floats(-0.9, 0.9), min_size=1, max_size=3, unique_by=lambda x: round(x, 1)),
    st.floats(0.6, 40),
    st.floats(2.5, 4.5),
)
def test_merges_that_fork_again(coming: list[float], going: list[float], middle: float, width: float) -> None:
    assume(all(b - a > 0.1 for a, b in pairwise(sorted(coming))))  # otherwise two lie on one ground
    lanes = [lane(1, [(0, 0), (middle, 0)], to=tuple(20 + k for k in range(len(going))), width=width)]
    for k, bend in enumerate(coming):
        line = bent((0, 0), np.pi, 45.0, bend)[::-1]
        lanes.append(lane(10 + k, line, to=(1,), width=width))
    lanes += [lane(20 + k, bent((middle, 0), 0.0, 45.0, bend), width=width) for k, bend in enumerate(going)]
    file = check(road(lanes))
    # Every way in leads to every way out, over an edge in between where there are several of both.
    ways = {(c.get("from", ""), c.get("to", "")) for c in file.connections.values()}
    reached = {start for start, _ in ways} - {end for _, end in ways}
    for _ in range(6):
        reached |= {end for start, end in ways if start.split("#")[0] in {r.split("#")[0] for r in reached}}
    assert {f"l{20 + k}" for k in range(len(going))} <= {r.split("#")[0] for r in reached}


@LIMITED
@given(st.integers(2, 4), st.data())
def test_rows_of_lanes_with_any_bans(count: int, choices: st.DataObject) -> None:
    lanes = []
    allowed = [
        (choices.draw(st.booleans(), f"{k} to {k + 1}"), choices.draw(st.booleans(), f"{k + 1} to {k}"))
        for k in range(count - 1)
    ]
    for part in (0, 1):
        for k in range(count):
            up = k + 1 < count and allowed[k][0]
            down = k > 0 and allowed[k - 1][1]
            lanes.append(
                lane(
                    10 * part + k + 1,
                    [(80 * part, 3.5 * k), (80 * part + 80, 3.5 * k)],
                    to=() if part else (10 + k + 1,),
                    left=10 * part + k + 2 if up else None,
                    right=10 * part + k if down else None,
                )
            )
    file = check(road(lanes))
    by_place = {
        (round(shape[0][1] / 3.5), round(shape[0][0] / 80)): name for name, shape in file.shapes.items()
    }
    for k, (up, down) in enumerate(allowed):
        lower, upper = by_place[k, 0], by_place[k + 1, 0]
        together = lower.rsplit("_", 1)[0] == upper.rsplit("_", 1)[0]
        assert together == (up or down)
        if together:
            assert (file.lanes[lower].get("changeLeft") is None) == up
            assert (file.lanes[upper].get("changeRight") is None) == down
