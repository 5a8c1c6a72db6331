"""Synthetic seed scenes: any converted map, populated by SUMO's own demand and car-following."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from scex_sumo.arrays import BoolArray, IntArray
from scex_sumo.errors import SimulationError, UsageError
from scex_sumo.geometry.rectangles import Rectangles, rectangle_distance
from scex_sumo.road import Road
from scex_sumo.scenarios.traffic.drive import Drive, record
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

WARM_UP_S = 30.0
FUTURE_STEPS = 100
# Traffic grows until the map holds enough: duration, and time between vehicles on a lane into the map at both
# ends. The second attempt is as much as gets in.
_ATTEMPTS = ((150.0, (40.0, 3.0)), (240.0, (6.0, 1.5)))
MOMENTS_TRIED = 100  # of each surplus
CHECKED_STEPS, CHECKED_STRIDE = 30, 2
SHARPEST = 0.25  # 1/m; a passenger car's turning circle has 5 m radius
SLOW_M = 0.1  # per step: 1 m/s


class Net(Protocol):
    """What is needed of a converted map."""

    @property
    def path(self) -> Path:
        """The SUMO net."""
        ...


MOST_VEHICLES = 5_000


def synthetic_scene(road: Road, net: Net, *, vehicles: int, seed: int = 0, name: str) -> SeedScene:
    """Populate a map by SUMO and take one moment of it, with what came before and after.

    Traffic enters on all lanes into the map at random, ever denser, and follows random routes with different
    drivers (EIDM). After the warm-up a moment is drawn among those with just enough vehicles that have been
    there for a second, and with livelier traffic than half of these; where all have more vehicles, the
    seed's are drawn from them.

    Args:
        net: its SUMO net.
        vehicles: how many the seed scene has, at least 1.
        seed: the same seed gives the same scene.
        name: of the seed scene.

    Returns:
        The seed scene; all 10 previous steps and up to 100 later ones are from the SUMO run.

    Raises:
        UsageError: fewer than one vehicle.
        SimulationError: SUMO refused the net, or the map cannot hold so many vehicles.
    """
    if vehicles < 1:
        raise UsageError(f"a synthetic seed needs at least 1 vehicle, not {vehicles}")
    if vehicles > MOST_VEHICLES:
        raise UsageError(f"--synthetic: got {vehicles:,}, at most {MOST_VEHICLES:,} vehicles are placed")
    if seed < 0:
        raise UsageError(f"--seed: got {seed}, needs 0 or more")
    rng = np.random.default_rng([seed, vehicles])
    most, spare = 0, None
    for duration_s, every_s in _ATTEMPTS:
        at_most = vehicles + max(3, vehicles // 2)  # more would only take time
        recording = record(net.path, at_most=at_most, duration_s=duration_s, every_s=every_s, rng=rng)
        ready = recording.steady()
        usable = ready[int(WARM_UP_S / STEP_S) : len(ready) - FUTURE_STEPS]
        most = max(most, int(usable.sum(axis=1).max(initial=0)))
        for step, chosen in _moments(recording, ready, vehicles, rng):
            scene = _scene(recording, step, chosen, name=name, location=road.name)
            if not _overlap(scene):
                spare = spare or scene
                if _sharpest(scene) <= SHARPEST:
                    return scene
    if spare is not None:
        return spare
    raise SimulationError(
        f"{road.name}: SUMO gets at most {most} vehicles onto the map at once, not {vehicles}; ask for fewer"
    )


def _scene(recording: Drive, step: int, chosen: IntArray, *, name: str, location: str) -> SeedScene:
    """The seed scene of some of the vehicles at one moment.

    Args:
        recording: a SUMO run.
        step: the moment.
        chosen: (V,) which vehicles; all of them present for the last 10 steps.
        name: of the seed scene.
        location: of the map.
    """
    tracks = [_track(recording, int(k), step) for k in chosen]
    states = States.stack([states for states, _ in tracks], 0)
    now = HISTORY_STEPS + 1
    return SeedScene(
        name=name,
        location=location,
        time_s=round(step * STEP_S, 1),
        track_ids=chosen + 1,
        types=tuple(recording.trips[k].kind for k in chosen),
        length=np.array([round(recording.trips[k].length_m, 2) for k in chosen]),
        width=np.array([round(recording.trips[k].width_m, 2) for k in chosen]),
        history=states[:, :now],
        recorded_steps=np.full(len(chosen), HISTORY_STEPS, dtype=np.int64),
        future=states[:, now:],
        future_valid=np.stack([valid for _, valid in tracks]),
        source={"synthetic": "SUMO demand and car-following (EIDM)"},
    )


def _moments(
    recording: Drive, ready: BoolArray, vehicles: int, rng: np.random.Generator
) -> Iterator[tuple[int, IntArray]]:
    """Moments with enough vehicles, and which of these: first those without surplus, in random order.

    Only the half in which traffic is faster: where a map is full, most moments are queues that stand still.
    """
    steps = np.arange(round(WARM_UP_S / STEP_S), len(ready) - FUTURE_STEPS)
    steps = steps[ready[steps].sum(axis=1) >= vehicles]
    if not len(steps):
        return
    surplus = recording.present[steps].sum(axis=1) - vehicles
    speed = np.nanmean(recording.speed[steps], axis=1)
    for extra in np.unique(surplus):
        of_these = steps[surplus == extra]
        fast = of_these[speed[surplus == extra] >= np.median(speed[surplus == extra])]
        for step in rng.permutation(fast)[:MOMENTS_TRIED]:
            yield int(step), np.sort(rng.choice(np.flatnonzero(ready[step]), vehicles, replace=False))


def _track(recording: Drive, vehicle: int, step: int) -> tuple[States, BoolArray]:
    """States of a vehicle from 10 steps before a moment, and which of those after it were driven."""
    first, states = recording.drive(vehicle, step)
    kept = states[step - HISTORY_STEPS - first : step + FUTURE_STEPS + 1 - first]
    now = HISTORY_STEPS + 1
    missing = now + FUTURE_STEPS - kept.shape[0]
    ahead = STEP_S * np.arange(1, missing + 1) * kept.speed[-1]
    heading = np.full(missing, kept.heading[-1])
    onwards = States(
        x=kept.x[-1] + ahead * np.cos(heading),
        y=kept.y[-1] + ahead * np.sin(heading),
        heading=heading,
        speed=np.full(missing, kept.speed[-1]),
    )
    valid = np.arange(now, now + FUTURE_STEPS) < kept.shape[0]
    return States.concatenate([kept, onwards], 0), valid


def _sharpest(scene: SeedScene) -> float:
    """Largest curvature that a moving vehicle drives, 1/m; maps have kinks that no car could follow."""
    assert scene.future is not None
    states = States.concatenate([scene.history, scene.future], 1)
    turned = np.abs(np.angle(np.exp(1j * np.diff(states.heading))))
    driven = states.speed[:, 1:] * STEP_S
    return float((turned / np.maximum(driven, SLOW_M)).max())


def _overlap(scene: SeedScene) -> bool:
    """Whether any two vehicles ever share ground from a second before the moment to 3 s after it.

    SUMO looks for collisions along lanes only; where a net's junctions hide a conflict, cars pass through
    each other.
    """
    assert scene.future is not None
    states = States.concatenate([scene.history, scene.future[:, :CHECKED_STEPS]], 1)[:, ::CHECKED_STRIDE]
    length, width = scene.length[:, None], scene.width[:, None]
    pairs = np.triu_indices(scene.vehicles, 1)
    one, two = (Rectangles.of(states[side], length[side], width[side]) for side in pairs)
    return bool((rectangle_distance(one, two) <= 0.0).any())
