"""Changed copies of a scene: vehicles moved sideways, tracked with noise, and standing ones in their way."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.paths import SeedPaths, path_positions, seed_paths
from scex_sumo.behaviors.models.idm import IdmParameters, idm_acceleration
from scex_sumo.geometry.polylines import wrap
from scex_sumo.learned.inputs.surface import path_room
from scex_sumo.learned.training.data.targets import right_paths
from scex_sumo.results.obstacles import joined
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S, Obstacles, SceneHistory, SeedScene, States, VehicleIndex

ASIDE_M, TURN_RAD = 0.7, float(np.deg2rad(5.0))  # of vehicles that are put off, to both sides
MOVED = 1.0  # share of the vehicles of a copy that are put off
SPEED_MPS = 0.7  # standard deviation of the errors of `measured`, for half of the vehicles
# Errors of NGSIM's tracks against a smooth motion: speeds of one track have similar errors for so long.
ALIKE_S = 0.15
CALM_MPS = 3.0  # below, errors shrink with the speed
MAX_OBSTACLES = 6  # in one scene
MIN_SPEED_MPS = 1.0  # slower vehicles are not blocked
BRAKING_MPS2 = (0.5, 5.0)  # that it takes to stop; its logarithm is drawn evenly
MAX_GAP_M = 80.0
ROOM_M = 8.0  # between the centres of a standing vehicle and of any other
SIZE_M = (4.6, 1.9)
STOP_GAP_M = 2.0
STOPPING = IdmParameters(
    time_headway=1.0,
    minimum_gap=STOP_GAP_M,
    max_acceleration=1.5,
    comfort_deceleration=2.5,
    max_deceleration=8.0,
)


def perturbed(history: States, rng: np.random.Generator) -> States:
    """Move vehicles (V, T) sideways and turn them, with their past; speeds stay."""
    count = history.shape[0]
    off = rng.random(count) < MOVED
    lateral = off * rng.uniform(-ASIDE_M, ASIDE_M, count)
    return moved(history, lateral, off * rng.uniform(-TURN_RAD, TURN_RAD, count))


def measured(history: States, rng: np.random.Generator) -> States:
    """Return states (V, T) of a worse tracker: half of the vehicles have a smooth error along their way."""
    count, steps = history.shape
    reach = 4  # steps, almost three times `ALIKE_S`
    t = STEP_S * np.arange(-reach, reach + 1)
    kernel = np.exp(-0.5 * (t / ALIKE_S) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    white = rng.standard_normal((count, steps + 2 * reach + 1))
    smooth = np.lib.stride_tricks.sliding_window_view(white, 2 * reach + 1, axis=1) @ kernel
    # The error of the speed is the slope of the place's.
    slope = np.diff(smooth, axis=1) / STEP_S
    size = np.where(rng.random(count) < 0.5, 0.0, SPEED_MPS * np.abs(rng.standard_normal(count)))
    calm = np.minimum(history.speed.mean(axis=1) / CALM_MPS, 1.0)
    unit = (size * calm * np.sqrt(2) * ALIKE_S)[:, None]
    travelled_m = unit * smooth[:, 1:]
    return States(
        x=history.x + travelled_m * np.cos(history.heading),
        y=history.y + travelled_m * np.sin(history.heading),
        heading=history.heading,
        speed=np.maximum(history.speed + unit * slope, 0.0),
    )


def moved(history: States, lateral: FloatArray, turn: FloatArray) -> States:
    """Shift tracks (V, T) to the left by (V,) m and turn them by (V,) rad, from their present pose."""
    now = history[:, -1]
    x = now.x - lateral * np.sin(now.heading)
    y = now.y + lateral * np.cos(now.heading)
    dx, dy = history.x - now.x[:, None], history.y - now.y[:, None]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    return States(
        x=x[:, None] + cos * dx - sin * dy,
        y=y[:, None] + sin * dx + cos * dy,
        heading=wrap(history.heading + turn[:, None]),
        speed=history.speed.copy(),
    )


def add_obstacles(
    scene: SeedScene, road: Road, usable: IntArray, rng: np.random.Generator
) -> tuple[SeedScene, IntArray] | None:
    """Put standing vehicles on the ways of some of a scene's vehicles.

    Returns:
        The scene with the standing vehicles at its end, and the vehicles that they block; None without any.
    """
    paths = seed_paths(scene, road)
    usable = usable[paths.on_road[usable] & (scene.now.speed[usable] > MIN_SPEED_MPS)]
    if not len(usable) or scene.future is None or scene.future_valid is None:
        return None
    path, owner, right = right_paths(
        paths, usable, scene.now[usable], scene.future[usable], scene.future_valid[usable]
    )
    _, first = np.unique(owner[right], return_index=True)
    path = path[right][first]
    place, free = _places(scene, road, paths, usable, path, rng)
    chosen: list[int] = []
    x, y = list(scene.now.x), list(scene.now.y)
    for k in rng.permutation(np.flatnonzero(free)):
        if len(chosen) < MAX_OBSTACLES and np.hypot(x - place.x[k], y - place.y[k]).min() > ROOM_M:
            chosen.append(int(k))
            x.append(place.x[k])
            y.append(place.y[k])
    return (_with_standing(scene, place[chosen]), usable[chosen]) if chosen else None


def _places(
    scene: SeedScene,
    road: Road,
    paths: SeedPaths,
    vehicle: IntArray,
    path: IntArray,
    rng: np.random.Generator,
) -> tuple[States, BoolArray]:
    vehicles = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    s, gap_ahead = standing_gap(SceneHistory.of_scene(scene), vehicles, paths, path)
    least, most = BRAKING_MPS2
    braking = least * (most / least) ** rng.random(len(vehicle))
    gap = np.minimum(STOP_GAP_M + scene.now.speed[vehicle] ** 2 / (2 * braking), MAX_GAP_M)
    arc_length = s + gap + (scene.length[vehicle] + SIZE_M[0]) / 2
    px, py, _, _, heading, _ = paths.at(path, arc_length)
    free = gap_ahead > gap + SIZE_M[0] + STOP_GAP_M
    free &= arc_length + SIZE_M[0] < path_room(paths, road).end[path]
    return States(x=px, y=py, heading=heading, speed=np.zeros_like(px)), free


def _with_standing(scene: SeedScene, place: States) -> SeedScene:
    assert scene.future is not None
    count, steps = len(place.x), scene.history.shape[1] + scene.future.shape[1]
    ids = scene.track_ids.max(initial=0) + 1 + np.arange(count)
    length, width = np.repeat([SIZE_M], count, axis=0).T
    standing = Obstacles(
        ids=tuple(map(str, ids.tolist())),
        types=("car",) * count,
        length=length,
        width=width,
        states=place.map(lambda values: np.repeat(values[:, None], steps, axis=1)),
        present=np.ones((count, steps), dtype=np.bool_),
    )
    recorded = np.full(count, scene.recorded_steps.max())
    sizes = length, width
    return joined(scene, standing, track_ids=ids, types=standing.types, sizes=sizes, recorded_steps=recorded)


def standing_gap(
    history: SceneHistory, vehicles: VehicleIndex, paths: SeedPaths, path: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return (n,) arc lengths of vehicles on their paths, and m to the next one on them; inf without one."""
    s, _, _ = path_positions(history, vehicles, paths, path)
    return s, find_leaders(history, vehicles, paths, path, s, clearance=1.5, radius=150.0).gap


def stopping_way(speed: FloatArray, gap: FloatArray, steps: int) -> FloatArray:
    """Return (n, H) m that vehicles travel until they stand behind one (n,) m ahead."""
    v, travelled_m, distances = speed, np.zeros_like(speed), []
    for _ in range(steps):
        a = idm_acceleration(STOPPING, v, np.maximum(speed, 8.0), gap - travelled_m, np.zeros_like(v))
        following = np.maximum(v + a * STEP_S, 0.0)
        travelled_m = travelled_m + (v + following) * (STEP_S / 2)
        v = following
        distances.append(travelled_m)
    return np.stack(distances, axis=1)
