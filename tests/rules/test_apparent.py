"""Lights of junctions whose map has none: where vehicles queue on two lanes."""

from __future__ import annotations

import numpy as np

from scex_sumo.rules.apparent import apparent_lights
from scex_sumo.rules.links import Link
from tests.behaviors.roads import Vehicle, scene_of

EAST = tuple((x, y, 0.0, 0.0) for y in (0.0, 3.5) for x in (-8.0, -15.0))  # two queues, fronts 5.75 m before


def links(*edges: str) -> list[Link]:
    """Ways through a junction at x = 0, from two lanes of edge a, and one of each other edge."""
    ways = [("a_0", (0.0, 0.0), (10.0, 0.0)), ("a_1", (0.0, 3.5), (10.0, 3.5))]
    ways += [(f"{edge}_0", (20.0 + k, 50.0), (20.0 + k, 60.0)) for k, edge in enumerate(edges)]
    return [
        Link(
            line=np.array([begin, end]),
            lanes=(lane, f":j_{k}_0", "out_0"),
            junction="j",
            row=k,
            state="m",
            light=None,
            yields=frozenset(),
        )
        for k, (lane, begin, end) in enumerate(ways)
    ]


def found(vehicles: tuple[Vehicle, ...], *edges: str) -> tuple[list[str], list[float]]:
    """Return the lanes with a light, and the places of the stop lines along the road."""
    lit, signals, stops = apparent_lights(scene_of(*vehicles), links(*edges))
    assert all(link.light in signals for link in lit)
    return [link.lanes[0] for link in lit], [round(float(line[0, 0]), 2) for line in stops]


def test_lanes_with_queues_have_one_light_and_stop_before_their_first_vehicle() -> None:
    assert found(EAST, "b", "c") == (["a_0", "a_1"], [-5.25, -5.25])
    assert len(apparent_lights(scene_of(*EAST), links("b", "c"))[1]) == 1
