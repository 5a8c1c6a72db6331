"""Expected motion of a seed scene: each vehicle's most likely line, and how far along it the vehicle will be.

The expected driver is the human-like one without spread and glances. Beyond its plan of 3 s a vehicle goes on
along its path at the last speed. Pedestrians and cyclists keep their velocity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.driving.paths import BEHIND_M, SeedPaths
from scex_sumo.behaviors.driving.projection import foot_points, sample_paths
from scex_sumo.certainty.response.motion.blocked import Lines
from scex_sumo.converters.tracks.road_users import PEOPLE, road_user
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.humans.lines.driven_line import driven_paths
from scex_sumo.results.participants import joined, some_obstacles
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Plan, SceneHistory, SeedScene, VehicleIndex

DRIVER: Final = "likely_driver:spread=0:inattention=0"
STEPS: Final = 80
"""Steps for which contact is looked for: one brakes from 20 m/s to a standstill with 4 m/s² after 3 s."""

_DRAWS = 5  # of the path; the line in the middle of them is the expected one
_SPACING_M = 1.0
_BACK_M = 10.0
_BEYOND_M = 10.0  # of the way at kept speed


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """Expected motion of the V vehicles of a seed scene, and of the people beside them.

    Attributes:
        scene: with people as its last vehicles; their ids are -1, -2, ... by their place in the obstacles.
        vehicles: V.
        lines: (V + P,) of centres; arc length 0 at the seed moment.
        s: (V + P, T) arc length now, after 0.1 s, ..., m.
        speed: (V + P, T) m/s.
    """

    scene: SeedScene
    vehicles: int
    lines: Lines
    s: FloatArray
    speed: FloatArray

    def at(self, row: IntArray, time_s: FloatArray) -> Mapping[str, FloatArray]:
        """Return arc length, speed and acceleration of vehicles (m,) at times (m, ...)."""
        row = row.reshape(row.shape + (1,) * (time_s.ndim - row.ndim))
        position = np.clip(time_s / STEP_S, 0.0, self.s.shape[1] - 1.0)
        index = np.minimum(position.astype(np.int64), self.s.shape[1] - 2)
        share, after = position - index, index + 1
        v, later = self.speed[row, index], self.speed[row, after]
        way = self.s[row, index] + share * (self.s[row, after] - self.s[row, index])
        return {"s": way, "speed": v + share * (later - v), "acceleration": (later - v) / STEP_S}


@owner_cache
def expected_motion(scene: SeedScene) -> Expected:
    """Return the expected motion of a seed scene that has a road."""
    assert scene.road is not None
    plan = _middle_plan(scene)
    paths = driven_paths(scene, scene.road)
    x = np.column_stack([scene.now.x, plan.x[:, :PLAN_STEPS]])
    y = np.column_stack([scene.now.y, plan.y[:, :PLAN_STEPS]])
    speed = np.column_stack([scene.now.speed, plan.speed[:, :PLAN_STEPS]])
    moved = np.hypot(np.diff(x, axis=1), np.diff(y, axis=1))
    s = np.column_stack([np.zeros(scene.vehicles), np.cumsum(moved, axis=1)])
    later = STEP_S * np.arange(1, STEPS - PLAN_STEPS + 1)
    speed = np.maximum(speed, 0.0)
    driven = Expected(
        scene=scene,
        vehicles=scene.vehicles,
        lines=_lines(scene, paths, x, y, s),
        s=np.column_stack([s, s[:, -1:] + speed[:, -1:] * later]),
        speed=np.column_stack([speed, np.repeat(speed[:, -1:], len(later), axis=1)]),
    )
    return with_people(driven)


def with_people(driven: Expected) -> Expected:
    """Return the expected motion of vehicles and of the pedestrians and cyclists of their scene."""
    scene, others = driven.scene, driven.scene.obstacles
    if others is None:
        return driven
    walking = [road_user(kind) in PEOPLE for kind in others.types]
    taking = others.present[:, HISTORY_STEPS] & np.array(walking, dtype=np.bool_)
    people = some_obstacles(others, taking)
    if people is None:
        return driven
    whole = joined(
        scene,
        people,
        track_ids=-1 - np.flatnonzero(taking),
        types=people.types,
        sizes=(people.length, people.width),
        recorded_steps=people.present[:, :HISTORY_STEPS].sum(axis=1),
    )
    here, old, count = people.states[:, HISTORY_STEPS], driven.lines, len(people.ids)
    way = old.start[0] + old.spacing_m * np.arange(old.x.shape[1])
    heading = np.repeat(here.heading[:, None], len(way), axis=1)
    speed = np.repeat(here.speed[:, None], driven.s.shape[1], axis=1)
    return Expected(
        scene=replace(whole, intentions=()),
        vehicles=driven.vehicles,
        lines=Lines(
            x=np.concatenate([old.x, here.x[:, None] + way * np.cos(heading)]),
            y=np.concatenate([old.y, here.y[:, None] + way * np.sin(heading)]),
            heading=np.concatenate([old.heading, heading]),
            start=np.full(len(old.start) + count, old.start[0]),
            spacing_m=old.spacing_m,
        ),
        s=np.concatenate([driven.s, speed * STEP_S * np.arange(driven.s.shape[1])]),
        speed=np.concatenate([driven.speed, speed]),
    )


def _middle_plan(scene: SeedScene) -> Plan:
    """Return the plan (V,) in the middle of those on several drawn paths."""
    (spec,) = parse_models(DRIVER)
    count, vehicles = _DRAWS, scene.vehicles
    draws = np.repeat((np.arange(count)[:, None] + 0.5) / count, vehicles, axis=1)
    states = scene.history.repeat(count)
    history = SceneHistory(scene=scene, states=states, futures=np.arange(count), step=0, route_draw=draws)
    future, vehicle = (index.ravel() for index in np.indices((count, vehicles)))
    who = VehicleIndex(future=future, vehicle=vehicle)
    assert scene.road is not None
    plan = build(spec).plan(history, scene.road, who, [np.random.default_rng(k) for k in range(count)])
    ends = np.stack([plan.x[:, PLAN_STEPS - 1], plan.y[:, PLAN_STEPS - 1]], -1).reshape(count, vehicles, 2)
    apart = np.abs(ends[:, None] - ends[None]).sum(axis=(1, 3))  # (draws, V)
    chosen = np.argmin(apart, axis=0) * vehicles + np.arange(vehicles)
    return Plan(x=plan.x[chosen], y=plan.y[chosen], heading=plan.heading[chosen], speed=plan.speed[chosen])


def _lines(scene: SeedScene, paths: SeedPaths, x: FloatArray, y: FloatArray, s: FloatArray) -> Lines:
    """Return lines through planned positions (V, H + 1), then along the nearest path at the same offset."""
    row = _nearest_rows(paths, x, y, s)
    foot, offset, _ = foot_points(paths, row, x[:, -1], y[:, -1], BEHIND_M + s[:, -1])
    reach = float((s[:, -1] + STEP_S * STEPS * np.maximum(scene.now.speed, 5.0)).max(initial=0.0)) + _BEYOND_M
    grid = np.arange(-_BACK_M, reach, _SPACING_M)
    beyond = np.maximum(grid - s[:, -1:], 0.0)
    px, py, cos, sin, _, _ = sample_paths(paths, np.repeat(row, len(grid)), (foot[:, None] + beyond).ravel())
    aside = np.repeat(offset, len(grid))
    points = np.stack([px - aside * sin, py + aside * cos], -1).reshape(len(row), len(grid), 2)
    back = np.minimum(grid, 0.0)
    for v, now in enumerate(scene.now.heading):
        planned, behind = grid <= s[v, -1], grid < 0
        for axis, (values, way) in enumerate(((x, np.cos(now)), (y, np.sin(now)))):
            points[v, planned, axis] = np.interp(grid[planned], s[v], values[v])
            points[v, behind, axis] += back[behind] * way
    step = np.gradient(points, axis=1)
    heading = np.unwrap(np.arctan2(step[..., 1], step[..., 0]), axis=1)
    start = np.full(len(row), grid[0])
    return Lines(x=points[..., 0], y=points[..., 1], heading=heading, start=start, spacing_m=_SPACING_M)


def _nearest_rows(paths: SeedPaths, x: FloatArray, y: FloatArray, s: FloatArray) -> IntArray:
    """Return the row of each vehicle's path that its plan is nearest to."""
    vehicle = np.repeat(np.arange(len(x)), paths.count)
    row, off = np.arange(len(vehicle)), np.zeros(len(vehicle))
    for step in (10, 20, PLAN_STEPS):
        at = (x[vehicle, step], y[vehicle, step], BEHIND_M + s[vehicle, step])
        off += np.abs(foot_points(paths, row, *at)[1])
    order = np.lexsort((off, vehicle))
    return np.asarray(order[np.searchsorted(vehicle[order], np.arange(len(x)))])
