"""Measures of drivers: how near they come to what really happened."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from recorded_scenes import ngsim_part

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior
from scex_sumo.behaviors.driving.motion import driven
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import load_recording
from scex_sumo.evaluation.split import Split
from scex_sumo.extrapolation.loop.rollout import Batch, roll_out
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.learned.decoding import intent_along
from scex_sumo.learned.driver import LearnedDriver
from scex_sumo.learned.training.data.dataset import part_scenes
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, States, VehicleIndex
from scex_sumo.world.plain import PlainWorld

MOVING_MPS = 0.5
GUESSES = 6


@dataclass(frozen=True, kw_only=True, eq=False)
class TestScene:
    """A seed scene of the test part.

    Attributes:
        site: where.
        scene: with its future.
        road: the map.
    """

    site: str
    scene: SeedScene
    road: Road


def test_scenes(recording: Recording, every_s: float) -> list[TestScene]:
    """Seed scenes of the test part of a recording that have a vehicle to measure."""
    loaded = load_recording(recording)
    # NGSIM's recordings are too short to be cut: all of a file that is kept for tests.
    kept = (recording.name,) if ngsim_part(recording.name) == "test" else ()
    scenes = part_scenes(loaded, "test", split=Split(kept_test=kept), every_s=every_s)
    return [TestScene(site=recording.site, scene=scene, road=loaded.road) for scene in scenes]


def straight_on(scene: SeedScene, vehicle: IntArray, *, stands: bool = False) -> FloatArray:
    """(k, H) distances of vehicles that keep velocity and heading (or stand still) to what they did, m."""
    now, way = scene.now[vehicle], STEP_S * np.arange(1, PLAN_STEPS + 1) * (not stands)
    return _distances(
        scene,
        vehicle,
        now.x[:, None] + (now.speed * np.cos(now.heading))[:, None] * way,
        now.y[:, None] + (now.speed * np.sin(now.heading))[:, None] * way,
    )


def planned(test: TestScene, model: BatchBehavior, vehicle: IntArray) -> FloatArray:
    """(k, H) distances of a model's plans to what the vehicles did, m."""
    vehicles = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    plan = model.plan(SceneHistory.of_scene(test.scene), test.road, vehicles, [np.random.default_rng(0)])
    return _distances(test.scene, vehicle, plan.x[:, :PLAN_STEPS], plan.y[:, :PLAN_STEPS])


def best_of_six(test: TestScene, driver: LearnedDriver, vehicle: IntArray) -> FloatArray:
    """(k,) distance after 3 s of the best of six plans, m.

    The six combinations of a candidate path and a mode that the network holds likeliest (the product of both
    probabilities), each driven as the driver would drive it.
    """
    seed, road = test.scene, test.road
    history = SceneHistory.of_scene(seed)
    everyone = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    paths, _ = chosen_paths(history, road, everyone, "straight")
    count = paths.count[vehicle]
    owner = np.repeat(np.arange(len(vehicle)), count)
    row = paths.first[vehicle][owner] + np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    pairs = VehicleIndex(future=np.zeros_like(owner), vehicle=vehicle[owner])
    _, modes = driver.predict(history, road, pairs, paths, row)
    logit, choice = modes.path_logit, modes.logits
    path = np.exp(logit - logit.max())
    path /= np.bincount(owner, path, minlength=len(vehicle))[owner]
    mode = np.exp(choice - choice.max(1, keepdims=True))
    likely = path[:, None] * mode / mode.sum(1, keepdims=True)
    pair, number = np.divmod(
        np.lexsort((-likely.ravel(), np.repeat(owner, likely.shape[1]))), likely.shape[1]
    )
    rank = np.arange(len(pair)) - np.searchsorted(owner[pair], owner[pair])
    pair, number = pair[rank < GUESSES], number[rank < GUESSES]
    vehicles = VehicleIndex(future=np.zeros_like(pair), vehicle=vehicle[owner[pair]])
    offset = modes.offset[pair, number]
    acceleration = modes.acceleration[pair, number]
    intent = intent_along(history, vehicles, paths, row[pair], acceleration, offset, road)
    plan = driven(history, [intent])[0]
    off = _distances(seed, vehicles.vehicle, plan.x, plan.y)[:, -1]
    best = np.full(len(vehicle), np.inf)
    np.minimum.at(best, owner[pair], off)
    return best


def _distances(scene: SeedScene, vehicle: IntArray, x: FloatArray, y: FloatArray) -> FloatArray:
    assert scene.future is not None
    steps = slice(0, PLAN_STEPS)
    distance: FloatArray = np.hypot(x - scene.future.x[vehicle, steps], y - scene.future.y[vehicle, steps])
    return distance


JOINT = ("minJointADE", "minJointFDE", "minJointMR", "cMR", "collided", "recorded")
"""Figures of `joint_figures`."""


def drawn_futures(test: TestScene, model: BatchBehavior, replan: int) -> States:
    """(C, H, V) futures of a scene with a model that drives everybody, a new plan every `replan` steps."""
    count, vehicles = 2 * GUESSES, test.scene.vehicles
    batch = Batch(
        futures=np.arange(count),
        assignment=np.zeros((count, vehicles), dtype=np.int64),
        models=(model,),
        names=("model",),
        overridden=np.array([True]),
        route_draw=np.random.default_rng(zlib.crc32(test.scene.name.encode())).random((count, vehicles)),
        generators=[np.random.default_rng([0, future]) for future in range(count)],
    )
    world = PlainWorld(count, vehicles)
    return roll_out(world, test.road, test.scene, batch, steps=PLAN_STEPS, replan=replan).states


def final_errors(test: TestScene, futures: States, vehicle: IntArray) -> FloatArray:
    """(C, k) distances of vehicles after 3 s in futures (C, H, V) to what they did, m."""
    assert test.scene.future is not None
    end, true = futures[:, -1, vehicle], test.scene.future[vehicle, PLAN_STEPS - 1]
    off: FloatArray = np.hypot(end.x - true.x, end.y - true.y)
    return off


def joint_figures(test: TestScene, futures: States, vehicle: IntArray) -> FloatArray:
    """The figures `JOINT` of futures (C, H, V) in groups of six, as INTERPRET defines them; errors in m.

    `cMR` is the smallest share of missed vehicles among futures without a collision, 1 if all have one;
    `collided` and `recorded` are the shares of futures, and of recordings, in which two vehicles collide.
    No vehicle is the ego, which INTERPRET leaves out.
    """
    groups = [futures[k : k + GUESSES] for k in range(0, len(futures.x), GUESSES)]
    return np.mean([_figures_of_six(test, six, vehicle) for six in groups], axis=0)


def _figures_of_six(test: TestScene, futures: States, vehicle: IntArray) -> FloatArray:
    scene, recorded = test.scene, test.scene.future
    assert recorded is not None
    future = recorded[vehicle, :PLAN_STEPS]
    made = futures.swapaxes(1, 2)[:, vehicle]
    off = np.hypot(made.x - future.x, made.y - future.y)
    missing = missed(future[:, -1], made[:, :, -1]).mean(1)
    counts = np.isin(np.arange(scene.vehicles), vehicle)
    hits = [collided(scene, futures[c].swapaxes(0, 1), counts)[vehicle] for c in range(len(missing))]
    free = ~np.array([hit.any() for hit in hits])
    return np.array(
        [
            off.mean((1, 2)).min(),
            off[..., -1].mean(1).min(),
            missing.min(),
            missing[free].min() if free.any() else 1.0,
            1 - free.mean(),
            collided(scene, recorded[:, :PLAN_STEPS], counts)[vehicle].any(),
        ]
    )


def missed(true: States, made: States) -> BoolArray:
    """(C, k) whether vehicles end over 1 m sideways, or 1 to 2 m along (by speed), from where they did."""
    dx, dy = made.x - true.x, made.y - true.y
    cos, sin = np.cos(true.heading), np.sin(true.heading)
    limit = np.interp(true.speed, (1.4, 11.0), (1.0, 2.0))
    return np.asarray((np.abs(cos * dx + sin * dy) > limit) | (np.abs(cos * dy - sin * dx) > 1.0))


def collided(scene: SeedScene, states: States, counts: BoolArray) -> BoolArray:
    """(V,) vehicles whose box comes to overlap another's in states (V, T); of those that count (V,)."""
    first, second = np.triu_indices(scene.vehicles, 1)
    fresh = counts[first] & counts[second] & ~_overlap(scene, scene.now, first, second)
    first, second = first[fresh], second[fresh]
    hit = np.zeros(scene.vehicles, dtype=np.bool_)
    reach = (np.hypot(scene.length, scene.width) / 2)[:, None]
    for step in range(states.shape[1]):
        now = states[:, step]
        near = np.hypot(now.x[first] - now.x[second], now.y[first] - now.y[second])
        near = near < (reach[first] + reach[second])[:, 0]
        i, j = first[near], second[near]
        both = _overlap(scene, now, i, j)
        hit[i[both]] = hit[j[both]] = True
    return hit


def _overlap(scene: SeedScene, now: States, i: IntArray, j: IntArray) -> BoolArray:
    one, two = (Rectangles.of(now[side], scene.length[side], scene.width[side]) for side in (i, j))
    return np.asarray(rectangle_distance(one, two) <= 0)


def moving(scene: SeedScene, vehicle: IntArray) -> BoolArray:
    """(k,) whether vehicles move at the moment."""
    return np.asarray(scene.now.speed[vehicle] > MOVING_MPS)
