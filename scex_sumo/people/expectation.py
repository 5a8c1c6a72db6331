"""Expected motion of people over the next 3 s: a small network of what the seed scene shows.

It reads a person's own last second, every vehicle that drives within `REACH_M` and every other person within
`PEOPLE_REACH_M`, in the direction of the last half second. It gives the way beyond constant velocity, along
and across. ``benchmarks/train_people.py`` trains it, and fits the scale of deviations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.cache import owner_cache
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene

SHOWN_STEPS: Final = 5  # over which speed and direction are measured
REACH_M, PEOPLE_REACH_M = 30.0, 8.0
DRIVES_M: Final = 0.5  # in the last second: people walk past parked vehicles as past walls
NEAR_M: Final = 5.0  # over which a pull decays by e
LOOK_S, CLOSE_M = 5.0, 3.0  # of the closest approach at constant velocity
MIN_DISTANCE_M: Final = 0.1  # distance in a direction
MAX_LOG: Final = 2.0  # of a scale in m
WEIGHTS: Final = Path(__file__).with_name("expectation.npz")


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownMotion:
    """What a scene shows of its V road users, and of K pairs of a person and another one near it."""

    speed: FloatArray  # (V,) of the last half second, m/s
    direction: FloatArray  # (V,) rad
    own: FloatArray  # (V, 23)
    of: IntArray  # (K,) the person
    by_person: BoolArray  # (K,) the other one is a person, too
    pairs: FloatArray  # (K, 11)


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """Expected motion of V road users, of use for people."""

    speed: FloatArray  # (V,) shown, m/s
    direction: FloatArray  # (V,) shown, rad
    beyond: FloatArray  # (V, 2) way beyond constant velocity after 3 s, along and across, m
    scale: FloatArray  # (V, 2) of Student's deviations from it, m


def shown(scene: SeedScene) -> ShownMotion:
    """Return the inputs of the network."""
    place = scene.history.x + 1j * scene.history.y
    velocity = (place[:, -1] - place[:, -1 - SHOWN_STEPS]) / (SHOWN_STEPS * STEP_S)
    speed = np.abs(velocity)
    direction = np.where(speed > 0.1, np.angle(velocity), scene.now.heading)
    turned = np.exp(-1j * direction)
    steps = np.diff(place, axis=1) / STEP_S * turned[:, None]
    bicycle = np.array([kind == "bicycle" for kind in scene.types], dtype=np.float64)
    recorded = scene.recorded_steps / HISTORY_STEPS
    own = np.column_stack([steps.real - speed[:, None], steps.imag, speed, bicycle, recorded])
    people = np.zeros(scene.vehicles, dtype=np.bool_) if scene.people is None else scene.people
    apart = np.abs(place[:, -1] - place[:, -1][:, None])
    drives = np.abs(place[:, -1] - place[:, 0]) > DRIVES_M
    near = people[:, None] & (apart < np.where(people, PEOPLE_REACH_M, REACH_M)) & (people | drives)
    np.fill_diagonal(near, False)
    of, other = np.nonzero(near)
    to = (place[other, -1] - place[of, -1]) * turned[of]
    closing = velocity[other] * turned[of] - speed[of]
    looks = np.exp(1j * scene.now.heading[other]) * turned[of]
    distance = apart[of, other]
    soon = -(to * closing.conj()).real / np.maximum(np.abs(closing) ** 2, 0.1)
    soon = np.clip(soon, 0.0, LOOK_S)
    pull = np.exp(-distance / NEAR_M)
    toward = pull * to / np.maximum(distance, MIN_DISTANCE_M)
    vectors = [part for z in (to / 10, closing / 3, looks) for part in (z.real, z.imag)]
    closest = np.exp(-np.abs(to + closing * soon) / CLOSE_M)
    pairs = np.column_stack([*vectors, pull, soon / LOOK_S, closest, toward.real, toward.imag])
    return ShownMotion(
        speed=speed, direction=direction, own=own, of=of, by_person=people[other], pairs=pairs.reshape(-1, 11)
    )


@owner_cache
def expected(scene: SeedScene) -> Expected:
    """Return the expected motion of the people of a scene."""
    seen, weights = shown(scene), _weights()
    sums = []
    for name, mine in (("vehicles", ~seen.by_person), ("people", seen.by_person)):
        each = _layers(weights, name, seen.pairs[mine], last=True)
        total = np.zeros((scene.vehicles, each.shape[1]))
        np.add.at(total, seen.of[mine], each)
        sums.append(total)
    out = _layers(weights, "own", np.column_stack([seen.own, *sums]), last=False)
    scale = np.exp(np.minimum(scale_features(seen.own) @ weights["scale"].T, MAX_LOG))
    return Expected(speed=seen.speed, direction=seen.direction, beyond=out, scale=scale)


def scale_features(own: FloatArray) -> FloatArray:
    """Return (V, 6) of which the logarithm of scales is linear: 1, speed, changes, bicycle, unknown past."""
    steps, (speed, bicycle, recorded) = own[:, :-3].reshape(len(own), 2, -1), own[:, -3:].T
    early, late = (np.hypot(*steps[:, :, part].mean(axis=2).T) for part in (slice(5), slice(-2, None)))
    return np.column_stack([np.ones(len(own)), np.log(0.3 + speed), early, late, bicycle, 1 - recorded])


def _layers(weights: dict[str, FloatArray], name: str, values: FloatArray, *, last: bool) -> FloatArray:
    """Return values after layers with ReLU between them, and after the last one if asked."""
    count = sum(key.startswith(f"{name}.") for key in weights) // 2
    for k in range(count):
        values = values @ weights[f"{name}.{k}.weight"].T + weights[f"{name}.{k}.bias"]
        if last or k < count - 1:
            values = np.maximum(values, 0.0)
    return values


@cache
def _weights() -> dict[str, FloatArray]:
    with np.load(WEIGHTS) as file:
        return {name: file[name].astype(np.float64) for name in file.files}
