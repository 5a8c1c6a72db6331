"""Generated scenes: vehicles placed one after another as in recordings, given those already there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import SimulationError, UsageError
from scex_sumo.generators.scene_context import (
    MIN_PACE_MPS,
    NO_VEHICLES,
    LaneCells,
    Placed,
    demands,
    lane_cells,
    needed_deceleration,
    place_features,
    states_of,
)
from scex_sumo.generators.scene_model import KINDS, SceneModel
from scex_sumo.geometry.polylines import wrap
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

MAX_VEHICLES = 500
CANDIDATES, PARTS = 512, 8  # places that are compared, and parts of the chosen one's surroundings
TRIES, AT_ONCE = 10, 12
SWEEPS = 1  # in which each vehicle is drawn anew, given all others
CLEAR_M = 0.1
FASTER = 1.1  # than it shall be, a scene may be
CHECKED_S = np.array([-1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0])


def generated_scene(
    road: Road,
    model: SceneModel,
    *,
    vehicles: int | None = None,
    seed: int = 0,
    number: int = 0,
    cells: BoolArray | None = None,
) -> SeedScene:
    """Return scene ``number`` of a seed, as recorded ones look, with 10 steps of history and no future.

    Vehicles do not overlap from 1 s before the moment to 2 s after it, if they follow their lanes at constant
    speed. None needs to brake harder for its leader than 99.5 % of the recorded vehicles.

    Args:
        vehicles: None draws the number, too.
        cells: (K,) cells of `lane_cells` on which vehicles may be; None for all.

    Raises:
        UsageError: no lanes for vehicles, or a number below 1 or above 500.
        SimulationError: the lanes have no room for so many.
    """
    if vehicles is not None and not 1 <= vehicles <= MAX_VEHICLES:
        raise UsageError(f"--vehicles: got {vehicles:,}, needs 1 to {MAX_VEHICLES}")
    if not road.vehicle_lanes:
        raise UsageError(f"{road.name}: the map has no lane for vehicles; give another map")
    if seed < 0:
        raise UsageError(f"--seed: got {seed}, needs 0 or more")
    rng, table = np.random.default_rng([seed, number, vehicles or 0]), lane_cells(road)
    allowed_m = table.cell_m if cells is None else table.cell_m * cells
    ends = np.cumsum(allowed_m)
    if ends[-1] <= 0:
        raise UsageError(f"{road.name}: no lane for vehicles in the region; give a larger one")
    count = vehicles or min(model.count(ends[-1], rng), MAX_VEHICLES)
    speed_mps = model.pace(allowed_m @ table.fixed / ends[-1], 1000.0 * count / ends[-1], ends[-1], rng)
    pace = max(speed_mps, MIN_PACE_MPS)
    scene, motion = NO_VEHICLES, _motion(table, NO_VEHICLES)
    for k in range(count * (1 + SWEEPS)):
        first = int(k >= count)
        others, moving = scene.take(slice(first, None)), motion[first:]
        vehicle = _drawn(table, ends, model, others, moving, count, pace, rng)
        if vehicle is None and k < count:
            raise SimulationError(
                f"{road.name}: no room for vehicle {k + 1} of {count} "
                f"on {ends[-1] / 1000:.2f} km of lanes; ask for fewer"
            )
        vehicle = scene.take(slice(1)) if vehicle is None else vehicle
        scene = Placed.join([others, vehicle])
        motion = States.concatenate([moving, _motion(table, vehicle)], 0)
    # Slower by one factor, vehicles are at the same places later: so none comes closer to another.
    slower = min(1.0, FASTER * pace / scene.pace)
    scene = replace(scene, speed=scene.speed * slower, acceleration=scene.acceleration * slower**2)
    history = states_of(table, scene, STEP_S * np.arange(-HISTORY_STEPS, 1.0))
    return SeedScene(
        name=f"{road.name}_generated{count}_s{seed}" + (f"_{number}" if number else ""),
        location=road.name,
        time_s=1.0,
        track_ids=np.arange(1, count + 1),
        types=tuple(KINDS[k] for k in scene.kind),
        length=scene.length.round(2),
        width=scene.width.round(2),
        history=replace(history, speed=_speeds(history)),
        recorded_steps=np.full(count, HISTORY_STEPS, dtype=np.int64),
        source={"generated": "scene model", "scenes_sha256": model.meta.get("sha256", ""), "seed": seed},
        road=road,
    )


def _speeds(states: States) -> FloatArray:
    """Return (n, T) speeds of positions; in curves those beside the centreline drive further or less."""
    middle = states.heading[:, 1:] - wrap(np.diff(states.heading)) / 2
    distance_m = np.diff(states.x) * np.cos(middle) + np.diff(states.y) * np.sin(middle)
    return np.maximum(np.concatenate([distance_m[:, :1], distance_m], axis=1) / STEP_S, 0.0)


def _drawn(
    table: LaneCells,
    ends: FloatArray,
    model: SceneModel,
    others: Placed,
    motion: States,
    count: int,
    pace: float,
    rng: np.random.Generator,
) -> Placed | None:
    """Draw one vehicle given the others and their `_motion`; None if no free place is found."""
    number = min(CANDIDATES, len(table.cell_lane))
    step_m = ends[-1] / number

    def at(distance_m: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        cell = np.minimum(np.searchsorted(ends, distance_m, side="right"), len(ends) - 1)
        lane = table.cell_lane[cell]
        s = table.cell_s[cell] + distance_m - (ends[cell] - table.cell_m[cell] / 2)
        return lane, s, place_features(table, lane, s, others, vehicles=count, total_m=ends[-1], pace=pace)

    travelled_m = (np.arange(number) + rng.random()) * step_m
    scores = model.place_scores(at(travelled_m)[2])
    for k in range(TRIES):  # the later, the less a place's score counts
        chosen = np.argsort(-(scores / (1 + k / 2) + rng.gumbel(size=number)), kind="stable")[:AT_ONCE]
        near = travelled_m[chosen][:, None] + step_m * ((np.arange(PARTS) + rng.random()) / PARTS - 0.5)
        near = np.clip(near, 0.0, ends[-1] - 1e-6)
        lane, s, features = at(near.ravel())
        finer = model.place_scores(features).reshape(near.shape)
        pick = (finer + rng.gumbel(size=finer.shape)).argmax(axis=1) + PARTS * np.arange(len(chosen))
        lane, s, features = lane[pick], s[pick], features[pick]
        values = model.draw(features, rng)
        values["speed"] *= pace
        values["acceleration"] = np.where(values["speed"] > 0, values["acceleration"], 0.0)
        tries = Placed(lane=lane, s=s, kind=values.pop("kind").astype(np.int64), **values)
        bounds = model.meta["bounds"]
        usual = [value <= bounds[name] for name, value in demands(table, tries).items()]
        tries = tries.take(np.all(usual, axis=0))
        tries = tries.take(_free(table, tries, others, motion, bounds["deceleration"]))
        if len(tries.lane):
            return tries.take(slice(1))
    return None


def _motion(table: LaneCells, vehicles: Placed) -> States:
    """Return (n, 7) states of vehicles: as they came, and at constant speed from now on."""
    acceleration = np.where(CHECKED_S > 0, 0.0, vehicles.acceleration[:, None])
    return states_of(table, replace(vehicles, acceleration=acceleration), CHECKED_S)


def _free(table: LaneCells, tries: Placed, others: Placed, motion: States, most_mps2: float) -> BoolArray:
    """Return (n,) whether each of the tried vehicles keeps off the others, and none must brake hard."""
    free = np.asarray((needed_deceleration(table, tries, others) <= most_mps2).all(axis=1))
    own = _motion(table, tries)
    tried, other = np.nonzero(np.broadcast_to(free[:, None], (len(free), len(others.lane))))
    closing_mps = own.speed.max(axis=1)[tried] + motion.speed.max(axis=1)[other]
    far = np.hypot(own.x[tried, 2] - motion.x[other, 2], own.y[tried, 2] - motion.y[other, 2])
    near = far < 2.0 * closing_mps + (tries.length[tried] + others.length[other]) + CLEAR_M
    tried, other = tried[near], other[near]
    boxes = (
        Rectangles.of(states[k], v.length[k, None], v.width[k, None])
        for states, v, k in ((own, tries, tried), (motion, others, other))
    )
    touch = (rectangle_distance(*boxes) <= CLEAR_M).any(axis=1)
    free[tried[touch]] = False
    return free
