"""Seed scenes of two cars on straight lines, with an expected motion at constant speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.certainty.response.motion.actions import TIME_S, Cases, cases_of, pairs_of
from scex_sumo.certainty.response.motion.blocked import Lines
from scex_sumo.certainty.response.motion.expected import Expected
from scex_sumo.scene import HISTORY_STEPS, Obstacles, SeedScene, States

LENGTH, WIDTH = 4.0, 2.0
PERSON_M = 0.6


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
        vehicles=count,
        lines=Lines.straight(now, 300.0),
        s=moves * TIME_S,
        speed=moves,
    )


def beside(expected: Expected, *people: tuple[float, ...]) -> Expected:
    """The same with pedestrians (x, y, heading) that stand, or (x, y, heading, speed) that walk."""
    x, y, heading, speed = np.array([(*person, 0.0)[:4] for person in people], dtype=float).T
    steps = np.ones((len(x), HISTORY_STEPS + 1))
    way = speed[:, None] * np.arange(-HISTORY_STEPS, 1) * 0.1
    states = States(
        x=x[:, None] + way * np.cos(heading)[:, None],
        y=y[:, None] + way * np.sin(heading)[:, None],
        heading=heading[:, None] * steps,
        speed=speed[:, None] * steps,
    )
    obstacles = Obstacles(
        ids=tuple(f"P{k}" for k in range(len(x))),
        types=("pedestrian",) * len(x),
        length=np.full(len(x), PERSON_M),
        width=np.full(len(x), PERSON_M),
        states=states,
        present=steps > 0,
    )
    return replace(expected, scene=replace(expected.scene, obstacles=obstacles))


def cases(expected: Expected, action: int) -> Cases:
    """The cases of one action; their ten values are consecutive."""
    found = cases_of(pairs_of(expected))
    return found.take(np.flatnonzero(found.action == action))
