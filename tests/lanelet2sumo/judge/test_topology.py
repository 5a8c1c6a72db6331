"""Moves of a net are those of its graph, whatever rings and dead ends it has."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scex_sumo.lanelet2sumo.convert import convert
from tests.converters.sumo_roads import arc, lane, road
from tests.lanelet2sumo.judge.mirrored import match_mirrored
from tests.lanelet2sumo.judge.topology import Moves


def test_routes_over_a_ring_and_its_arms_are_all_pairs_that_one_can_drive(tmp_path: Path) -> None:
    ring = {1: (0.0, 120.0, (2,)), 2: (120.0, 240.0, (3, 5)), 3: (240.0, 360.0, (1,))}
    lanes = [lane(i, arc((0, 0), 30.0, start, end), to=to) for i, (start, end, to) in ring.items()]
    lanes.append(lane(4, [(30.0, -60.0), (30.0, 0.0)], to=(1,)))
    away = np.radians(240.0) + np.pi / 2
    tip = 30.0 * np.array([np.cos(np.radians(240.0)), np.sin(np.radians(240.0))])
    lanes.append(lane(5, [tuple(tip), tuple(tip + 50.0 * np.array([np.cos(away), np.sin(away)]))]))
    drawn = road(lanes)
    net = convert(drawn, tmp_path / "ring.net.xml")
    moves = Moves(match_mirrored(net.path, drawn, net.lanes))
    onto_ring = {(i, j) for i in (1, 2, 3, 4) for j in (1, 2, 3, 5) if i != j}
    assert set(moves.pairs(moves.routes)) == onto_ring
    assert moves.pairs(moves.border(moves.routes)) == [(4, 5)]
    assert moves.pairs(moves.missing) == moves.pairs(moves.invented) == []
