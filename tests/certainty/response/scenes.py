"""Seed scenes of two cars on straight lines, with an expected motion at constant speed."""

from __future__ import annotations

import numpy as np

from scex_sumo.certainty.response.actions import TIME_S, Cases, cases_of, pairs_of
from scex_sumo.certainty.response.blocked import Lines
from scex_sumo.certainty.response.expected import Expected
from scex_sumo.scene import SeedScene, States

LENGTH, WIDTH = 4.0, 2.0


def steady(*vehicles: tuple[float, float, float, float], waits: tuple[int, ...] = ()) -> Expected:
    """Vehicles (x, y, heading, speed) that keep their speed; those that wait stand from the next step on."""
    x, y, heading, speed = (np.array(column, dtype=float) for column in zip(*vehicles, strict=True))
    count, times = len(x), np.arange(-10, 1) * 0.1
    now = States(x=x, y=y, heading=heading, speed=speed)
    whole = np.ones((count, 11))
    way = speed[:, None] * times
    scene = SeedScene(
        name="steady",
        location="nowhere",
        time_s=0.0,
        track_ids=np.arange(1, count + 1),
        types=("car",) * count,
        length=np.full(count, LENGTH),
        width=np.full(count, WIDTH),
        history=States(
            x=x[:, None] + way * np.cos(heading)[:, None],
            y=y[:, None] + way * np.sin(heading)[:, None],
            heading=heading[:, None] * whole,
            speed=speed[:, None] * whole,
        ),
        recorded_steps=np.full(count, 10),
    )
    moves = np.where(np.isin(np.arange(count), waits), 0.0, speed)[:, None] * np.ones(len(TIME_S))
    return Expected(
        scene=scene,
        lines=Lines.straight(now, 300.0),
        s=moves * TIME_S,
        speed=moves,
    )


def cases(expected: Expected, action: int) -> Cases:
    """The cases of one action; their ten values are consecutive."""
    found = cases_of(pairs_of(expected))
    return found.take(np.flatnonzero(found.action == action))
