"""Measures of drivers: how near they come to what really happened, and what they do in 10 s by themselves."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import numpy as np
from recorded_scenes import ngsim_part

from scex_sumo import example_path
from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior
from scex_sumo.behaviors.driving.motion import driven
from scex_sumo.behaviors.driving.paths import BEHIND_M, chosen_paths, seed_paths
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.evaluation.split import Split
from scex_sumo.extrapolation.loop.rollout import Batch, roll_out
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.learned.decoding import intent_along, way_of
from scex_sumo.learned.driver import LearnedDriver
from scex_sumo.learned.inputs.surface import Surface, path_room, surface_of
from scex_sumo.learned.training.closed_loop import REPLAN, drive_all
from scex_sumo.learned.training.data.dataset import part_scenes
from scex_sumo.learned.training.data.perturb import Perturbation, perturbed
from scex_sumo.learned.training.data.targets import smooth_return
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SceneHistory, SeedScene, States, VehicleIndex
from scex_sumo.world.plain import PlainWorld

MOVING_MPS = 0.5
CHANGE_MPS = 3.0
GUESSES = 6
LOOP_STEPS = 100
EXAMPLE_FUTURES, EXAMPLE_STEPS = 8, 50
LOOK_STEPS = 5  # leaving the road is looked for every half second
STANDING_M = 0.01  # per step
OUTSIDE = 0.15  # of the box
HARD_MPS2 = 6.0


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


def foreseen(scene: SeedScene, vehicle: IntArray, kept: float) -> FloatArray:
    """(k, H) distances of drivers who know the next second, and the way, to what the vehicles did, m.

    Speed and acceleration are those of a parabola through the way of the second before and after the moment;
    they go on with a share of the acceleration, and stop rather than reverse.

    Args:
        kept: share of the acceleration.
    """
    assert scene.future is not None
    x, y = (np.concatenate([getattr(scene.history, k), getattr(scene.future, k)], 1)[vehicle] for k in "xy")
    present = HISTORY_STEPS
    way = np.cumsum(np.hypot(np.diff(x, axis=1), np.diff(y, axis=1)), axis=1)
    way = np.concatenate([np.zeros((len(vehicle), 1)), way], 1)
    way -= way[:, present : present + 1]
    t = STEP_S * np.arange(-HISTORY_STEPS, HISTORY_STEPS + 1)
    fit = np.linalg.pinv(np.vander(t, 3, increasing=True))
    _, speed, half = (way[:, : 2 * present + 1] @ fit.T).T
    acceleration = np.repeat(2 * kept * half[:, None], PLAN_STEPS, axis=1)
    off: FloatArray = np.abs(
        way_of(np.maximum(speed, 0.0), acceleration)[:, 1:] - way[:, present + 1 : present + 1 + PLAN_STEPS]
    )
    return off


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


def drawn_futures(
    test: TestScene,
    model: BatchBehavior,
    count: int = 2 * GUESSES,
    replan: int = REPLAN,
    steps: int = PLAN_STEPS,
) -> States:
    """(C, H, V) futures of a scene with a model that drives everybody, a new plan every `replan` steps."""
    vehicles = test.scene.vehicles
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
    return roll_out(world, test.road, test.scene, batch, steps=steps, replan=replan).states


def example_collisions(name: str, model: BatchBehavior) -> tuple[int, int]:
    """Futures of 5 s of an example recording, one moment every 3 s, in which two vehicles collide; all."""
    (recording,) = (r for r in find_recordings([example_path(name).parent]) if r.name == name)
    loaded, hit, steps = load_recording(recording), [], EXAMPLE_STEPS
    for moment in recording_moments(loaded, every_s=3.0):
        test = TestScene(site=name, scene=seed_at(loaded, moment.time_s), road=loaded.road)
        futures = drawn_futures(test, model, EXAMPLE_FUTURES, PLAN_STEPS, steps)
        counts = np.ones((test.scene.vehicles, steps), dtype=np.bool_)
        hit += [
            _collided(test.scene, test.scene, future.swapaxes(0, 1), counts).any()
            for future in (futures[c] for c in range(EXAMPLE_FUTURES))
        ]
    return int(np.sum(hit)), len(hit)


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
    counts = np.zeros((scene.vehicles, PLAN_STEPS), dtype=np.bool_)
    counts[vehicle] = True
    hits = [_collided(scene, scene, futures[c].swapaxes(0, 1), counts)[vehicle] for c in range(len(missing))]
    free = ~np.array([hit.any() for hit in hits])
    return np.array(
        [
            off.mean((1, 2)).min(),
            off[..., -1].mean(1).min(),
            missing.min(),
            missing[free].min() if free.any() else 1.0,
            1 - free.mean(),
            _collided(scene, scene, recorded[:, :PLAN_STEPS], counts)[vehicle].any(),
        ]
    )


def missed(true: States, made: States) -> BoolArray:
    """(C, k) whether vehicles end over 1 m sideways, or 1 to 2 m along (by speed), from where they did."""
    dx, dy = made.x - true.x, made.y - true.y
    cos, sin = np.cos(true.heading), np.sin(true.heading)
    limit = np.interp(true.speed, (1.4, 11.0), (1.0, 2.0))
    return np.asarray((np.abs(cos * dx + sin * dy) > limit) | (np.abs(cos * dy - sin * dx) > 1.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Loop:
    """What the vehicles of a scene did in 10 s of closed loop; (V,) each.

    Attributes:
        driven: vehicles that were on the mapped road at the beginning.
        left: more than `OUTSIDE` of the box off the drivable surface, after it had been on it.
        collided: the box overlapped another's; pairs that overlapped at the start, or were recorded so, as a
            car and its trailer, left out.
        hard: the speed changed by more than `HARD_MPS2` for a step.
    """

    driven: BoolArray
    left: BoolArray
    collided: BoolArray
    hard: BoolArray


def perturbed_start(test: TestScene) -> SeedScene:
    """The scene with all vehicles put off by up to 0.7 m and 5 degrees; always the same."""
    rng = np.random.default_rng(zlib.crc32(test.scene.name.encode()))
    return replace(test.scene, history=perturbed(test.scene.history, Perturbation(), rng))


def closed_loop(test: TestScene, model: BatchBehavior, *, perturbs: bool) -> Loop:
    """Let a model drive all vehicles of a scene for 10 s, a new plan every 0.5 s."""
    start = perturbed_start(test) if perturbs else test.scene
    states = drive_all(start, test.road, model, steps=LOOP_STEPS)[0].swapaxes(0, 1)
    return judged(test, start, states)


def recorded_motion(test: TestScene, *, perturbs: bool) -> Loop:
    """What was recorded, as long as it was (at most 5 s); from a perturbed start, on the way back to it.

    The way back is the one that networks are taught.
    """
    scene, future = test.scene, test.scene.future
    assert future is not None
    if not perturbs:
        return judged(test, scene, future)
    start = perturbed_start(test)
    now, put = scene.now, start.now
    cos, sin = np.cos(now.heading), np.sin(now.heading)
    aside = cos * (put.y - now.y) - sin * (put.x - now.x)
    slope = np.tan(put.heading - now.heading)
    step = np.hypot(
        np.diff(future.x, axis=1, prepend=now.x[:, None]), np.diff(future.y, axis=1, prepend=now.y[:, None])
    )
    off = smooth_return(aside, slope, now.speed, np.cumsum(step, axis=1))
    turned = np.arctan(_leaning(step, np.diff(off, axis=1, prepend=aside[:, None]), slope))
    x, y = future.x - np.sin(future.heading) * off, future.y + np.cos(future.heading) * off
    return judged(test, start, States(x=x, y=y, heading=future.heading + turned, speed=future.speed))


def _leaning(step: FloatArray, change: FloatArray, slope: FloatArray) -> FloatArray:
    """(V, T) way aside per way ahead, the last one of who stands; slope before all steps."""
    moves = step > STANDING_M
    lean = np.concatenate([slope[:, None], change / np.where(moves, step, 1.0)], axis=1)
    last = np.maximum.accumulate(np.where(moves, np.arange(1, lean.shape[1]), 0), axis=1)
    leaning: FloatArray = np.take_along_axis(lean, last, axis=1)
    return leaning


def judged(test: TestScene, scene: SeedScene, states: States) -> Loop:
    """What (V, T) states are, from a start on.

    A vehicle counts as long as its box is on the mapped stretch of one of its paths: no road is drawn beyond.

    Args:
        scene: the start.
    """
    road = test.road
    on_map = _on_map(scene, road, states)
    outside = np.stack(
        [_outside(surface_of(road), scene, states[:, k]) for k in range(0, states.shape[1], LOOK_STEPS)], 1
    )
    looked = on_map[:, ::LOOK_STEPS]
    been = np.maximum.accumulate((outside <= OUTSIDE) & looked, axis=1)
    speed = np.concatenate([scene.now.speed[:, None], states.speed], 1)
    hard = (np.abs(np.diff(speed, axis=1)) > HARD_MPS2 * STEP_S) & on_map
    return Loop(
        driven=seed_paths(scene, road).on_road,
        left=((outside > OUTSIDE) & been & looked).any(1),
        collided=_collided(scene, test.scene, states, on_map),
        hard=hard.any(1),
    )


def _on_map(scene: SeedScene, road: Road, states: States) -> BoolArray:
    """(V, T) whether the whole box is before the end of the mapped road, on the nearest of its paths."""
    paths = seed_paths(scene, road, 18.0)
    end = path_room(paths, road).end
    vehicles, steps = states.shape
    nearest = np.full((vehicles, steps), np.inf)
    before = np.zeros((vehicles, steps), dtype=np.bool_)
    moved = np.hypot(np.diff(states.x, axis=1, prepend=scene.now.x[:, None]),
                     np.diff(states.y, axis=1, prepend=scene.now.y[:, None]))  # fmt: skip
    expected = BEHIND_M + np.cumsum(moved, axis=1)
    for k in range(int(paths.count.max())):
        some = np.flatnonzero(paths.count > k)
        row = np.repeat((paths.first + k)[some], steps)
        s, d, _ = paths.foot_points(
            row, states.x[some].ravel(), states.y[some].ravel(), expected[some].ravel()
        )
        s, d = s.reshape(len(some), steps), np.abs(d).reshape(len(some), steps)
        closer = d < nearest[some]
        inside = s + scene.length[some, None] / 2 < end[(paths.first + k)[some], None]
        before[some] = np.where(closer, inside, before[some])
        nearest[some] = np.where(closer, d, nearest[some])
    left: BoolArray = np.logical_and.accumulate(before, axis=1) & paths.on_road[:, None]
    return left


def _outside(surface: Surface, scene: SeedScene, states: States) -> FloatArray:
    """(V,) share of each box that is off the drivable surface, from 5 x 20 points of it."""
    along, across = np.meshgrid((np.arange(5) - 2) / 5, (np.arange(20) - 9.5) / 20, indexing="ij")
    u, v = along.ravel() * scene.length[:, None], across.ravel() * scene.width[:, None]
    cos, sin = np.cos(states.heading)[:, None], np.sin(states.heading)[:, None]
    depth = surface.at(states.x[:, None] + cos * u - sin * v, states.y[:, None] + sin * u + cos * v)
    share: FloatArray = (depth < 0).mean(axis=1)
    return share


def _collided(scene: SeedScene, recorded: SeedScene, states: States, counts: BoolArray) -> BoolArray:
    """(V,) vehicles whose box comes to overlap another's at a step at which both count."""
    first, second = np.triu_indices(scene.vehicles, 1)
    fresh = ~_overlap(scene, scene.now, first, second) & ~_overlap(scene, recorded.now, first, second)
    first, second = first[fresh], second[fresh]
    hit = np.zeros(scene.vehicles, dtype=np.bool_)
    reach = (np.hypot(scene.length, scene.width) / 2)[:, None]
    for step in range(states.shape[1]):
        now = states[:, step]
        near = np.hypot(now.x[first] - now.x[second], now.y[first] - now.y[second])
        near = (near < (reach[first] + reach[second])[:, 0]) & counts[first, step] & counts[second, step]
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


def changing(scene: SeedScene, vehicle: IntArray) -> BoolArray:
    """(k,) whether vehicles change their speed by more than `CHANGE_MPS` in the next 3 s."""
    assert scene.future is not None
    change = scene.future.speed[vehicle, PLAN_STEPS - 1] - scene.now.speed[vehicle]
    return np.asarray(np.abs(change) > CHANGE_MPS)
