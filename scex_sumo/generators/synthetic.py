"""Synthetic seed scenes: a map populated without a recording, by SUMO's demand or the scene model."""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.arrays import BoolArray, IntArray
from scex_sumo.base.cache import cached_object
from scex_sumo.base.errors import SimulationError, UsageError, warn_notes
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import version_of
from scex_sumo.converters.maps import read_map
from scex_sumo.generators.drive import Drive, record
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_model import load_scenes
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.road import Road
from scex_sumo.roads.mirror import drawn_on
from scex_sumo.scene import HISTORY_STEPS, STEP_S, Obstacles, SeedScene, States

WARM_UP_S = 30.0
FUTURE_STEPS = 100
# Duration, and time between vehicles on an entry lane at the beginning and at the end, s.
_ATTEMPTS = ((150.0, (40.0, 3.0)), (240.0, (6.0, 1.5)))
MAX_MOMENTS, MAX_ALIKE = 500, 100  # per attempt, and per number of vehicles
CHECKED_STEPS, CHECKED_STRIDE = 30, 2
MAX_CURVATURE = 0.25  # 1/m; a car's turning radius is 5 m
SLOW_M = 0.1  # per step: 1 m/s
MAX_VEHICLES = 5_000
MAX_VEHICLE_STEPS = 1_000_000  # that SUMO simulates for one scene
MAX_PAIRS = 10**9  # of vehicles, at all moments of an attempt together
DENSE, DENSE_EVERY_S = 40, (5.0, 2.0)  # vehicles on the map, and s between two on an entry lane, at most
FILLED_STEPS = 150  # in which the first vehicles reach crossings
SUMO, RECORDED = "sumo", "recorded"


@checked
def synthetic_seed(
    map_path: str | Path,
    *,
    vehicles: int,
    like: str = "sumo",
    seed: int = 0,
    origin: tuple[float, float] | None = None,
    cache: bool = True,
    progress: Progress | bool | None = None,
) -> SeedScene:
    """Populate a map and return one moment.

    Args:
        map_path: a Lanelet2 map (``.osm``), or a CommonRoad scenario (``.xml``, ``.xml.gz``).
        like: ``sumo`` places vehicles by random demand and car-following, with history and future;
            ``recorded`` by the shipped scene model, without a future.
        seed: the same seed gives the same scene.
        origin: latitude and longitude of the map's coordinates; None looks beside the map, else takes its
            south-west corner.
        cache: keep road, net and scene in ``~/.cache/scex-sumo``.
        progress: True for a bar; or called with (done, total) while SUMO simulates.

    Raises:
        MapError: the map cannot be read.
        SimulationError: the map cannot hold so many vehicles, or SUMO would simulate too long.
        UsageError: ``like`` is unknown.

    Example:
        >>> scex.synthetic_seed(scex.example_path("roundabout"), vehicles=3).vehicles
        3
    """
    if like not in (SUMO, RECORDED):
        raise UsageError(f"--as: unknown population {like!r}; known: {SUMO}, {RECORDED}")
    road = read_map(map_path, origin=origin, own_corner=True, keep=cache)
    if like == SUMO:
        draw = partial(sumo_population, vehicles=vehicles, seed=seed, cache=cache, progress=progress)
    else:
        draw = partial(generated_scene, model=load_scenes(), vehicles=vehicles, seed=seed)
    # SUMO's own nets say on which side they are driven.
    scene = replace(drawn_on(road, draw) if road.net is None else draw(road), road=road)
    warn_notes([*road.notes, *scene.notes])
    return scene


def sumo_population(
    road: Road, *, vehicles: int, seed: int = 0, cache: bool = True, progress: Progress | bool | None = None
) -> SeedScene:
    """Populate a road by SUMO's demand and car-following; ``cache`` keeps net and scene on the disk."""
    name = f"{road.name}_synthetic{vehicles}_s{seed}"

    def populated() -> SeedScene:
        with TemporaryFolder() as folder, progress_of(progress, name) as tick:
            net = converted(road, Path(folder) / f"{road.name}.net.xml", keep=cache)
            return synthetic_scene(road, net.path, vehicles=vehicles, seed=seed, name=name, progress=tick)

    if not cache:
        return populated()
    made_of = pickle.dumps((version_of("eclipse-sumo"), vehicles, seed, road))
    return cached_object("populated", made_of, populated, (SeedScene, States, Obstacles))


def synthetic_scene(
    road: Road,
    net: Path,
    *,
    vehicles: int,
    seed: int = 0,
    name: str,
    progress: Callable[[int, int], None] | None = None,
) -> SeedScene:
    """Populate a road's SUMO net and return one moment, with 10 steps of history and up to 100 of future.

    Ever denser traffic enters on all lanes into the map, with random routes and drivers (EIDM). The moment is
    drawn among the faster half of those with just enough vehicles; if all have more, vehicles are drawn.

    Args:
        progress: called with the simulated steps, and with those of all attempts.

    Raises:
        UsageError: a number of vehicles or a seed out of range.
        SimulationError: the map cannot hold so many vehicles, or more than `MAX_VEHICLE_STEPS` are simulated.
    """
    if vehicles < 1:
        raise UsageError(f"--synthetic: got {vehicles}, needs at least 1 vehicle")
    if vehicles > MAX_VEHICLES:
        raise UsageError(f"--synthetic: got {vehicles:,}, at most {MAX_VEHICLES:,} vehicles are placed")
    if seed < 0:
        raise UsageError(f"--seed: got {seed}, needs 0 or more")
    rng = np.random.default_rng([seed, vehicles])
    most, tried, spare, simulated = 0, 0, None, 0
    begun_s, total_s = 0.0, sum(duration_s for duration_s, _ in _ATTEMPTS)

    def tick(time_s: float, vehicle_steps: int) -> None:
        if progress is not None:
            progress(round((begun_s + time_s) / STEP_S) + 1, round(total_s / STEP_S))
        if simulated + vehicle_steps > MAX_VEHICLE_STEPS:
            raise SimulationError(
                f"{road.name}: no moment with {vehicles} vehicles in {MAX_VEHICLE_STEPS:,} simulated vehicle "
                f"steps ({tried} tried); ask for fewer, or give a smaller map"
            )

    for duration_s, every_s in _ATTEMPTS:
        at_most = vehicles + max(3, vehicles // 2)
        recording = record(net, at_most=at_most, duration_s=duration_s, every_s=every_s, rng=rng, tick=tick)
        simulated += int(recording.present.sum())
        begun_s += duration_s
        ready = recording.steady()
        usable = ready[int(WARM_UP_S / STEP_S) : len(ready) - FUTURE_STEPS]
        most = max(most, int(usable.sum(axis=1).max(initial=0)))
        for step, chosen in _moments(recording, ready, vehicles, rng):
            tried += 1
            scene = _scene(recording, step, chosen, name=name, location=road.name)
            sharp = _sharpest(scene) > MAX_CURVATURE
            if (sharp and spare is not None) or _overlap(scene):
                continue
            if not sharp:
                return scene
            spare = scene
    if spare is not None:
        return spare
    if tried:
        raise SimulationError(
            f"{road.name}: some of {vehicles} vehicles overlap at all {tried} moments tried, because SUMO "
            "misses conflicts of this map's lanes; ask for fewer"
        )
    raise SimulationError(
        f"{road.name}: SUMO gets at most {most} vehicles onto the map at once, not {vehicles}; ask for fewer"
    )


def simulated_scenes(road: Road, net: Path, *, seconds: float, every_s: float) -> list[SeedScene]:
    """Return moments of dense traffic that SUMO drives over a net, each as `synthetic_scene`.

    Drivers differ in desired speed, gaps, acceleration and impatience at crossings. Moments are left out in
    which two vehicles overlap from 1 s before to 3 s after, because SUMO missed a conflict of lanes.
    """
    rng = np.random.default_rng([0, zlib.crc32(road.name.encode())])
    drive = record(net, at_most=DENSE, duration_s=seconds, every_s=DENSE_EVERY_S, rng=rng)
    ready, scenes = drive.steady(), []
    for step in range(FILLED_STEPS, len(ready) - FUTURE_STEPS, round(every_s / STEP_S)):
        if len(chosen := np.flatnonzero(ready[step])):
            name = f"{road.name}_simulated{step * STEP_S:g}"
            scene = _scene(drive, step, chosen, name=name, location=road.name)
            scenes += [] if _overlap(scene) else [replace(scene, road=road)]
    return scenes


def _scene(recording: Drive, step: int, chosen: IntArray, *, name: str, location: str) -> SeedScene:
    steps = np.arange(step - HISTORY_STEPS, step + FUTURE_STEPS + 1)[:, None]
    stretch, driven_states = recording.drives
    driven = stretch[steps, chosen] == stretch[step, chosen]
    last = driven.sum(axis=0) - 1
    states = driven_states[steps, chosen]
    end = states[last, np.arange(len(chosen))]
    distance_m = STEP_S * (np.arange(len(steps))[:, None] - last) * end.speed
    onwards = end.ahead(distance_m.T, np.repeat(end.speed[:, None], len(steps), axis=1)).swapaxes(0, 1)
    states = States.joined([states, onwards], lambda parts: np.where(driven, *parts).T.copy())
    now = HISTORY_STEPS + 1
    trips = [recording.trips[k] for k in chosen]
    return SeedScene(
        name=name,
        location=location,
        time_s=round(step * STEP_S, 1),
        track_ids=recording.number[chosen] + 1,
        types=tuple(trip.kind for trip in trips),
        length=np.array([round(trip.length_m, 2) for trip in trips]),
        width=np.array([round(trip.width_m, 2) for trip in trips]),
        history=states[:, :now],
        recorded_steps=np.full(len(chosen), HISTORY_STEPS, dtype=np.int64),
        future=states[:, now:],
        future_valid=driven[now:].T.copy(),
        source={"synthetic": "SUMO demand and car-following (EIDM)"},
    )


def _moments(
    recording: Drive, ready: BoolArray, vehicles: int, rng: np.random.Generator
) -> Iterator[tuple[int, IntArray]]:
    """Yield moments with enough vehicles and the chosen ones, by surplus, then at random."""
    steps = np.arange(round(WARM_UP_S / STEP_S), len(ready) - FUTURE_STEPS)
    steps = steps[ready[steps].sum(axis=1) >= vehicles]
    if not len(steps):
        return
    surplus = recording.present[steps].sum(axis=1) - vehicles
    speed = np.nanmean(recording.speed[steps], axis=1)
    left = max(min(MAX_MOMENTS, MAX_PAIRS // vehicles**2), 1)
    for extra in np.unique(surplus):
        of_these = steps[surplus == extra]
        fast = of_these[speed[surplus == extra] >= np.median(speed[surplus == extra])]
        for step in rng.permutation(fast)[: min(MAX_ALIKE, left)]:
            left -= 1
            yield int(step), np.sort(rng.choice(np.flatnonzero(ready[step]), vehicles, replace=False))


def _sharpest(scene: SeedScene) -> float:
    assert scene.future is not None
    states = States.concatenate([scene.history, scene.future], 1)
    turned = np.abs(np.angle(np.exp(1j * np.diff(states.heading))))
    driven = states.speed[:, 1:] * STEP_S
    return float((turned / np.maximum(driven, SLOW_M)).max())


def _overlap(scene: SeedScene) -> bool:
    """Return whether two vehicles overlap from 1 s before the moment to 3 s after it."""
    assert scene.future is not None
    states = States.concatenate([scene.history, scene.future[:, :CHECKED_STEPS]], 1)[:, ::CHECKED_STRIDE]
    length, width = scene.length[:, None], scene.width[:, None]
    first, second = np.triu_indices(scene.vehicles, 1)
    near, reach = np.full(len(first), True), np.hypot(scene.length, scene.width) / 2
    for place in (states.x, states.y):
        low, high = place.min(axis=1) - reach, place.max(axis=1) + reach
        near &= (low[first] <= high[second]) & (low[second] <= high[first])
    pairs = first[near], second[near]
    boxes = (Rectangles.of(states[side], length[side], width[side]) for side in pairs)
    return bool((rectangle_distance(*boxes) <= 0.0).any())
