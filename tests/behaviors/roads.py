"""Small roads drawn by hand, and seed scenes on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.road import Lane, Road
from scex_sumo.scene import Obstacles, Plan, SceneHistory, SeedScene, States, VehicleIndex
from tests.seeds import Vehicle, seed_of, steady


def lane(
    lane_id: int,
    points: Sequence[tuple[float, float]] | np.ndarray,
    *,
    width: float = 3.5,
    limit: float = 15.0,
    **fields: Any,
) -> Lane:
    """A lane whose bounds are its centreline."""
    line = np.array(points, dtype=float)
    shape = {"centreline": line, "left_bound": line, "right_bound": line}
    return Lane(lane_id=lane_id, **shape, width_m=width, speed_limit_mps=limit, **fields)


def road(*lanes: Lane) -> Road:
    return Road(name="drawn", lanes={one.lane_id: one for one in lanes})


def straight(length: float = 600.0, limit: float = 15.0) -> Road:
    """One lane along +x from x = 0."""
    return road(lane(1, [(0.0, 0.0), (length, 0.0)], limit=limit))


def arc(
    radius: float,
    angle: float,
    start: tuple[float, float] = (0.0, 0.0),
    heading: float = 0.0,
    step: float = 1.0,
) -> np.ndarray:
    """Points of an arc that starts along a heading; a positive angle turns left."""
    n = max(2, int(radius * abs(angle) / step) + 1)
    side = np.sign(angle)
    turn = np.linspace(0.0, abs(angle), n)
    ahead, left = radius * np.sin(turn), side * radius * (1 - np.cos(turn))
    cos, sin = np.cos(heading), np.sin(heading)
    return np.column_stack([start[0] + cos * ahead - sin * left, start[1] + sin * ahead + cos * left])


def fork() -> Road:
    """Lane 1 along +x to x = 50, then left (11, up), straight on (12), right (13, down), 60 m each."""
    up, down = arc(15.0, np.pi / 2, (50.0, 0.0)), arc(15.0, -np.pi / 2, (50.0, 0.0))
    return road(
        lane(1, [(0.0, 0.0), (50.0, 0.0)], successors=(11, 12, 13)),
        lane(11, [*map(tuple, up), (65.0, 60.0)], predecessors=(1,)),
        lane(12, [(50.0, 0.0), (110.0, 0.0)], predecessors=(1,)),
        lane(13, [*map(tuple, down), (65.0, -60.0)], predecessors=(1,)),
    )


def scene_of(
    *vehicles: Vehicle, length: float = 4.5, width: float = 1.8, obstacles: Obstacles | None = None
) -> SeedScene:
    """A seed scene of vehicles that have driven straight at constant speed for a second."""
    sizes = {"length": np.full(len(vehicles), length), "width": np.full(len(vehicles), width)}
    return seed_of(steady(*vehicles), **sizes, obstacles=obstacles)


def present(scene: SeedScene, futures: int = 1, draw: np.ndarray | None = None) -> SceneHistory:
    """The history of several futures at the moment of the seed scene."""
    return SceneHistory(
        scene=scene,
        states=States.stack([scene.history] * futures, axis=0),
        futures=np.arange(futures),
        step=0,
        route_draw=np.zeros((futures, scene.vehicles)) if draw is None else draw,
    )


def every(history: SceneHistory) -> VehicleIndex:
    c, v = np.indices(history.now.shape).reshape(2, -1)
    return VehicleIndex(future=c, vehicle=v)


def generators(history: SceneHistory) -> list[np.random.Generator]:
    return [np.random.default_rng(int(c)) for c in history.futures]


def plan(
    model: BatchBehavior, where: Road, history: SceneHistory, vehicles: VehicleIndex | None = None
) -> Plan:
    return model.plan(history, where, every(history) if vehicles is None else vehicles, generators(history))


def closed_loop(
    model: BatchBehavior,
    where: Road,
    scene: SeedScene,
    *,
    steps: int,
    replan: int,
    futures: int = 1,
    draw: np.ndarray | None = None,
) -> States:
    """Drive all vehicles of a scene by one model, exactly as planned: (C, V, steps)."""
    history = present(scene, futures, draw)
    driven = []
    for step in range(steps):
        if step % replan == 0:
            made = plan(model, where, history)
        state = made[:, step % replan].map(lambda values: values.reshape(futures, -1))
        driven.append(state)
        states = States.stack([*(history.states[:, :, i] for i in range(1, 11)), state], axis=2)
        history = replace(history, states=states, step=step + 1)
    return States.stack(driven, axis=2)
