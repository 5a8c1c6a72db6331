"""Lanes and lights of exported ground truth."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scex_sumo.converters.maps import read_map
from scex_sumo.converters.xml import net_root
from scex_sumo.exporters.request import EXPORTERS, Request
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.results.run import Run
from scex_sumo.road import Lane

betterosi = pytest.importorskip("betterosi")


@pytest.fixture(scope="module")
def trace(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("osi")
    first: Path = EXPORTERS.load("osi")(Request(run=run, futures=(1,), out=out))[0]
    return first


def numbers(items: Any) -> Iterator[int]:
    for one in items:
        yield one.id.value


def test_lanes_of_a_trace_without_opendrive_are_those_of_the_map(run: Run, trace: Path) -> None:
    own = Request(run=run, futures=(1,)).road
    (alone := trace.with_name("alone")).mkdir()
    bare = alone / "trace.osi"
    bare.write_bytes(trace.read_bytes())
    back = read_map(bare)
    driven = [lane for lane in own.lanes.values() if lane.kind != "pedestrian"]

    def ends(lanes: Iterable[Lane]) -> set[tuple[float, ...]]:
        return {tuple(lane.centreline[[0, -1]].ravel().round(3)) for lane in lanes}

    assert ends(back.lanes.values()) == ends(driven)
    changes = [sum(lane.left is not None for lane in lanes) for lanes in (driven, back.lanes.values())]
    assert changes[0] == changes[1]


def test_negative_ids_of_lanes_become_numbers_of_osi(run: Run, tmp_path: Path) -> None:
    asked = Request(run=run, futures=(1,), out=tmp_path)
    turned = {i: -i for i in asked.road.lanes}

    def others(lanes: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(turned[i] for i in lanes)

    asked.__dict__["road"] = replace(
        asked.road,
        lanes={
            -i: replace(
                lane, lane_id=-i, successors=others(lane.successors), predecessors=others(lane.predecessors),
                conflicts=others(lane.conflicts), left=None, right=None, adjacent_left=None,
                adjacent_right=None, reverse_of=None,
            )
            for i, lane in asked.road.lanes.items()
        },
        regulations=(),
        file=None,
    )  # fmt: skip
    first = next(betterosi.read(str(EXPORTERS.load("osi")(asked)[0]), return_ground_truth=True))
    assert len(first.lane) == len(turned) and min(numbers(first.lane)) > 0


def links(net: Path) -> list[tuple[np.ndarray, int, ET.Element]]:
    """Where each link of a light begins and ends, its index, and its programme."""
    root = net_root(net)
    shapes = {
        lane.get("id"): np.array([p.split(",")[:2] for p in lane.get("shape", "").split()], float)
        for lane in root.iter("lane")
    }
    lights = {light.get("id"): light for light in root.iter("tlLogic")}
    return [
        (
            np.concatenate(
                [
                    shapes[f"{x.get('from')}_{x.get('fromLane')}"][-1],
                    shapes[f"{x.get('to')}_{x.get('toLane')}"][0],
                ]
            ),
            int(x.get("linkIndex", "")),
            lights[x.get("tl")],
        )
        for x in root.iter("connection")
        if x.get("tl") is not None
    ]


def letters(light: ET.Element, link: int, times: np.ndarray) -> str:
    """What a link shows, at times of the simulation."""
    phases = list(light.iter("phase"))
    ends = np.cumsum([float(p.get("duration", "")) for p in phases])
    at = np.searchsorted(ends, (times - float(light.get("offset", "0"))) % ends[-1], side="right")
    return "".join(phases[k].get("state", "")[link].lower() for k in at.tolist())


def test_lights_of_an_export_come_back_at_the_same_links(lit_run: Run, tmp_path: Path) -> None:
    file = EXPORTERS.load("omega-prime")(Request(run=lit_run, futures=(0,), out=tmp_path))[0]
    back = convert(read_map(file), tmp_path / "back.net.xml", signals=file)
    own, steps = links(lit_run.net.path), lit_run.states(0).shape[1] - 1
    times = 0.1 * np.arange(steps) + 0.05
    lit = set()
    for place, link, light in links(back.path):
        begin, end = (
            np.array([np.abs(one[0] - place)[k].max() for one in own]) for k in (slice(2), slice(2, 4))
        )
        near = own[int(np.lexsort((end, begin > 2.5))[0])]  # a turn may be held before its junction
        assert np.abs(near[0] - place)[:2].max() < 2.5
        assert letters(light, link, times) == letters(near[2], near[1], times - 0.9)
        lit.add(tuple(near[0][:2]))
    assert lit == {tuple(one[0][:2]) for one in own}
