"""Small seed scenes for tests, made by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.road import Lane, Road
from scex_sumo.scene import (
    HISTORY_STEPS,
    STEP_S,
    Obstacles,
    Plan,
    SceneHistory,
    SeedScene,
    States,
    VehicleIndex,
)

PAST_S = STEP_S * np.arange(-10, 1)
Vehicle = tuple[float, float, float, float]  # x, y, heading, speed


def going_on(now: States, time_s: FloatArray) -> States:
    """(V, T) straight on from (V,) states, at their speed."""
    speed = np.repeat(now.speed[:, None], len(time_s), axis=1)
    return now.ahead(speed * time_s, speed)


def states_of(*vehicles: Vehicle) -> States:
    """(V,) states of vehicles at x, y, heading and speed."""
    x, y, heading, speed = np.array(vehicles, dtype=float).reshape(-1, 4).T.copy()
    return States(x=x, y=y, heading=heading, speed=speed)


def steady(*vehicles: Vehicle, time_s: FloatArray = PAST_S) -> States:
    """(V, T) straight on at constant speed, of vehicles at x, y, heading and speed at 0 s."""
    return going_on(states_of(*vehicles), time_s)


def standing(now: States) -> States:
    """(V, 11) the same for a second."""
    return now.map(lambda values: np.repeat(values[:, None], len(PAST_S), axis=1))


def seed_of(history: States, **fields: Any) -> SeedScene:
    """Cars of 4.5 m x 1.8 m, numbered from 1, with a past (V, 11); other fields of a scene replace these."""
    count = len(history.x)
    usual = {
        "name": "drawn",
        "location": "nowhere",
        "time_s": 0.0,
        "track_ids": np.arange(1, count + 1),
        "types": ("car",) * count,
        "length": np.full(count, 4.5),
        "width": np.full(count, 1.8),
        "recorded_steps": np.full(count, 10),
    }
    return SeedScene(**{**usual, "history": history, **fields})


def straight_seed(vehicles: int = 2, speed: float = 10.0) -> SeedScene:
    """Vehicles side by side, 10 m apart, numbered from 0, that have driven along +x for the last second."""
    history = steady(*((0.0, 10.0 * row, 0.0, speed) for row in range(vehicles)))
    return seed_of(history, track_ids=np.arange(vehicles))


def people_of(states: States, *types: str, length: Any = 0.6, width: Any = 0.6, **fields: Any) -> Obstacles:
    """People P1, P2, … with states (P, 11 + F), present all the time; without types they walk or ride."""
    count = len(states.x)
    usual = {
        "ids": tuple(f"P{number}" for number in range(1, count + 1)),
        "types": types or ("pedestrian/bicycle",) * count,
        "length": np.full(count, length),
        "width": np.full(count, width),
        "present": np.ones(states.shape, dtype=bool),
    }
    return Obstacles(**{**usual, "states": states, **fields})


def long_recorded(scene: SeedScene) -> SeedScene:
    """A seed scene without the vehicles that were recorded for less than a second before it."""
    return scene.reordered(np.flatnonzero(scene.recorded_steps >= HISTORY_STEPS).tolist(), name=scene.name)


def lane_along(lane_id: int, points: Any, *, width: float = 3.5, **fields: Any) -> Lane:
    """A lane of constant width around a centreline of points (N, 2), with a limit of 13.89 m/s."""
    line = np.array(points, dtype=float)
    headings = np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))
    headings = np.concatenate([headings[:1], (headings[1:] + headings[:-1]) / 2, headings[-1:]])
    left = width / 2 * np.stack([-np.sin(headings), np.cos(headings)], axis=1)
    shape = {"centreline": line, "left_bound": line + left, "right_bound": line - left, "width_m": width}
    return Lane(**{"lane_id": lane_id, **shape, "speed_limit_mps": 13.89, **fields})


def same_bytes(one: States, other: States) -> bool:
    """Whether two states are the same to the last bit."""
    names = "x", "y", "heading", "speed"
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in names)


class Straight:
    """Drives straight on at its present speed; `change` spoils the plan of all vehicles in a call."""

    steps = 30

    def __init__(self, change: Callable[[Plan, VehicleIndex], Plan] | None = None) -> None:
        self.seen: list[SceneHistory] = []
        self.change = change

    def plan(
        self, history: SceneHistory, road: Road, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        self.seen.append(history)
        now = history.now[vehicles.future, vehicles.vehicle]
        going = going_on(now, STEP_S * np.arange(1, self.steps + 1))
        plan = Plan(x=going.x, y=going.y, heading=going.heading, speed=going.speed)
        return plan if self.change is None else self.change(plan, vehicles)
