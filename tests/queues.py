"""Seed scenes of vehicles in rows on straight lanes, for tests of influence sets."""

from __future__ import annotations

from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from tests.seeds import lane_along, seed_of, steady


def queues(*rows: int, gap_m: float = 7.5, speed: float = 12.0) -> SeedScene:
    """Rows of cars, one behind the other on a lane of their own; the first one of each row leads it.

    Tracks are numbered from 1, row by row, each from its leader backwards; lanes are 50 m apart.
    """
    lanes, vehicles = {}, []
    for row, count in enumerate(rows):
        lanes[row + 1] = lane_along(row + 1, [(-300.0, 50.0 * row), (600.0, 50.0 * row)])
        vehicles += [(-(4.5 + gap_m) * k, 50.0 * row, 0.0, speed) for k in range(count)]
    return seed_of(steady(*vehicles), road=Road(name="queues", lanes=lanes))
