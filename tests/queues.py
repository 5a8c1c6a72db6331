"""Seed scenes of vehicles in rows on straight lanes, for tests of influence sets."""

from __future__ import annotations

import numpy as np

from scex_sumo.road import Lane, Road
from scex_sumo.scene import SeedScene, States


def queues(*rows: int, gap_m: float = 7.5, speed: float = 12.0) -> SeedScene:
    """Rows of cars, one behind the other on a lane of their own; the first one of each row leads it.

    Tracks are numbered from 1, row by row, each from its leader backwards; lanes are 50 m apart.
    """
    lanes, x, y = {}, [], []
    for row, count in enumerate(rows):
        line = np.array([[-300.0, 50.0 * row], [600.0, 50.0 * row]])
        side = np.array([[0.0, 1.75]])
        lanes[row + 1] = Lane(
            lane_id=row + 1,
            centreline=line,
            left_bound=line + side,
            right_bound=line - side,
            width_m=3.5,
            speed_limit_mps=14.0,
        )
        x += [-(4.5 + gap_m) * k for k in range(count)]
        y += [50.0 * row] * count
    vehicles, times = len(x), np.arange(-10, 1) * 0.1
    whole = np.ones((vehicles, 11))
    return SeedScene(
        name="queues",
        location="nowhere",
        time_s=0.0,
        track_ids=np.arange(1, vehicles + 1),
        types=("car",) * vehicles,
        length=np.full(vehicles, 4.5),
        width=np.full(vehicles, 1.8),
        history=States(
            x=np.array(x)[:, None] + speed * times,
            y=np.array(y)[:, None] * whole,
            heading=0.0 * whole,
            speed=speed * whole,
        ),
        recorded_steps=np.full(vehicles, 10),
        road=Road(name="queues", lanes=lanes),
    )
