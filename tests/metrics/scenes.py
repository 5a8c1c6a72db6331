"""Scenes for the metric tests, built by hand or drawn at random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.collisions import find_collisions
from scex_sumo.metrics.encounters import Encounters, encounters_of
from scex_sumo.metrics.evaluate import scene_batches
from scex_sumo.scene import STEP_S, States


def one_scene(
    vehicles: Sequence[dict[str, float]], *, length: float = 4.5, width: float = 1.8
) -> SceneTracks:
    """One future of one evaluated step after one step of history, which gives each vehicle its ``a``.

    Keys of a vehicle: x, y, psi, v, and optionally a, length, width.
    """

    def column(name: str, default: float = 0.0) -> FloatArray:
        return np.array([v.get(name, default) for v in vehicles], dtype=float)

    speed = column("v")
    return SceneTracks(
        states=States(
            x=np.stack([column("x")] * 2)[None],
            y=np.stack([column("y")] * 2)[None],
            heading=np.stack([column("psi")] * 2)[None],
            speed=np.stack([speed - column("a") * STEP_S, speed])[None],
        ),
        length=column("length", length),
        width=column("width", width),
        first=1,
    )


def paths_of(*polylines: Sequence[tuple[float, float]]) -> tuple[SceneTracks, PlannedPaths]:
    """One step: each vehicle at the first point of its polyline, planning the others, at 10 m/s."""
    columns = max(len(p) for p in polylines) - 1
    full = np.array([list(p) + [p[-1]] * (columns + 1 - len(p)) for p in polylines], dtype=float)
    tracks = one_scene([{"x": p[0][0], "y": p[0][1], "psi": 0.0, "v": 10.0} for p in polylines])
    planned = PlannedPaths(
        x=full[None, None, :, 1:, 0],
        y=full[None, None, :, 1:, 1],
        index=np.zeros(1, dtype=np.int64),
        column=np.zeros(1, dtype=np.int64),
    )
    return tracks, planned


def with_speeds(tracks: SceneTracks, *speeds: float) -> SceneTracks:
    """The same with other constant speeds."""
    speed = np.broadcast_to(np.array(speeds), tracks.states.shape).copy()
    return replace(tracks, states=replace(tracks.states, speed=speed))


def random_run(
    rng: np.random.Generator,
    *,
    futures: int = 2,
    vehicles: int = 5,
    steps: int = 6,
    history: int = 4,
    area: float = 40.0,
    absent: float = 0.0,
    replan: int = 3,
    planned_steps: int = 9,
) -> tuple[SceneTracks, PlannedPaths]:
    """Vehicles that wander, some standing, with plans that differ from what they do."""
    shape = (futures, vehicles)
    heading = rng.choice([0.0, 0.1, np.pi / 2, 3.0, -1.6], shape) + rng.normal(0, 0.2, shape)
    speed = rng.uniform(0, 18, shape) * (rng.random(shape) > 0.15)
    x, y = rng.uniform(0, area, shape), rng.uniform(0, area, shape)
    states = States.empty((futures, history + steps, vehicles))
    plans: list[tuple[FloatArray, FloatArray]] = []
    for step in range(history + steps):
        states.x[:, step], states.y[:, step] = x, y
        states.heading[:, step], states.speed[:, step] = heading, speed
        since = step - (history - 1)
        if since >= 0 and since % replan == 0 and since < steps:
            plans.append(_plan(rng, x, y, heading, speed, planned_steps))
        speed = np.where(speed > 0, np.maximum(speed + rng.normal(0, 0.4, shape), 0), 0.0)
        heading = heading + rng.normal(0, 0.03, shape)
        x, y = x + speed * STEP_S * np.cos(heading), y + speed * STEP_S * np.sin(heading)
    present: BoolArray | None = None
    if absent:
        present = rng.random(states.shape) > absent
        states.assign(~present, States(x=np.nan, y=np.nan, heading=np.nan, speed=np.nan))
    tracks = SceneTracks(
        states=states,
        length=rng.uniform(0, 8, vehicles),
        width=rng.uniform(0, 2.5, vehicles),
        present=present,
        first=history,
    )
    plan_x, plan_y = (np.stack([p[i] for p in plans], axis=1) for i in (0, 1))
    return tracks, PlannedPaths.from_replans(plan_x, plan_y, np.arange(0, steps, replan), steps)


def _plan(
    rng: np.random.Generator, x: FloatArray, y: FloatArray, heading: FloatArray, speed: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    turn = np.cumsum(rng.normal(0, 0.15, (*x.shape, steps)), axis=-1) + heading[..., None]
    stride = 4 * speed[..., None] * STEP_S  # coarse plans, so that many of them cross
    return x[..., None] + np.cumsum(stride * np.cos(turn), -1), y[..., None] + np.cumsum(
        stride * np.sin(turn), -1
    )


def moved(tracks: SceneTracks, planned: PlannedPaths, motion: Any) -> tuple[SceneTracks, PlannedPaths]:
    """Positions and headings through ``motion(x, y, heading) -> (x, y, heading)``."""
    x, y, heading = motion(tracks.states.x, tracks.states.y, tracks.states.heading)
    plan_x, plan_y, _ = motion(planned.x, planned.y, np.zeros_like(planned.x))
    states = replace(tracks.states, x=x, y=y, heading=heading)
    return replace(tracks, states=states), replace(planned, x=plan_x, y=plan_y)


def find_encounters(tracks: SceneTracks, planned: PlannedPaths | None) -> Encounters:
    """Encounters of all pairs in all futures."""
    hits = find_collisions(tracks)
    batches = scene_batches(tracks, planned)
    return Encounters.join([encounters_of(scenes, hits, start) for start, scenes in batches])
