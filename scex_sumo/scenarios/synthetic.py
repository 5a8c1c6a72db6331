"""Synthetic seed scenes: any converted map, populated by SUMO's own demand and car-following."""

from __future__ import annotations

import csv
import os
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import sumo

from scex_sumo.errors import SimulationError, UsageError
from scex_sumo.metrics.rectangles import rectangle_distance
from scex_sumo.road import Road
from scex_sumo.scenarios.demand import Network, Trip, random_trips, write_curve_limits, write_trips
from scex_sumo.scenarios.kinematics import body_states
from scex_sumo.scene import HISTORY_STEPS, STEP_S, BoolArray, FloatArray, IntArray, SeedScene, States

WARM_UP_S = 45.0
FUTURE_STEPS = 100
LANE_CHANGE_S = 4.0
TELEPORT_S = 20.0
MAX_DELAY_S = 15.0
# More vehicles than asked for, in this share, and longer: where they leave so fast that all of them are
# never there for a whole second.
_ATTEMPTS = ((1.0, 100.0, 8.0), (1.3, 120.0, 5.0), (2.0, 160.0, 3.0))
MOMENTS_TRIED = 200
CHECKED_STEPS, CHECKED_STRIDE = 30, 2
JUMP_M = 0.5  # further than driven in one step: SUMO moved the vehicle by other means


class Net(Protocol):
    """What is needed of a converted map."""

    @property
    def path(self) -> Path:
        """The SUMO net."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Everything that drove in one SUMO run.

    Attributes:
        trips: (K,) the vehicles.
        present: (T, K) on the map at the step.
        front: (T, K, 2) front bumper, m; NaN where not present.
        angle: (T, K) SUMO's heading as ours, rad.
        speed: (T, K) SUMO's speed, m/s.
    """

    trips: list[Trip]
    present: BoolArray
    front: FloatArray
    angle: FloatArray
    speed: FloatArray


def synthetic_seed(road: Road, net: Net, *, vehicles: int, seed: int = 0, name: str) -> SeedScene:
    """Populate a map by SUMO and take one moment of it, with what came before and after.

    Traffic enters on all lanes into the map at random, follows random routes with different drivers (EIDM),
    and is held at the wanted number of vehicles. After the warm-up a moment is drawn among those with just
    enough vehicles that have been there for a second; where there are more, the seed's are drawn from them.

    Args:
        road: the map.
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
    rng = np.random.default_rng([seed, vehicles])
    most = 0
    for share, duration_s, per_origin_s in _ATTEMPTS:
        recording = record(
            net.path,
            at_most=int(np.ceil(share * vehicles)),
            duration_s=duration_s,
            per_origin_s=per_origin_s,
            rng=rng,
        )
        ready = steady(recording)
        usable = ready[int(WARM_UP_S / STEP_S) : len(ready) - FUTURE_STEPS]
        most = max(most, int(usable.sum(axis=1).max(initial=0)))
        for step, chosen in _moments(recording, ready, vehicles, rng):
            scene = scene_at(recording, step, chosen, name=name, location=road.name)
            if not _overlap(scene):
                return scene
    raise SimulationError(
        f"{road.name}: SUMO gets at most {most} vehicles onto the map at once, not {vehicles}; ask for fewer"
    )


def record(
    net_path: Path, *, at_most: int, duration_s: float, per_origin_s: float, rng: np.random.Generator
) -> Recording:
    """Let SUMO drive random traffic over a net.

    Args:
        net_path: the net.
        at_most: vehicles on the map at any time; others wait outside.
        duration_s: simulated time.
        per_origin_s: mean time between vehicles on a lane into the map.
        rng: where the randomness comes from.
    """
    trips = random_trips(Network(net_path), until_s=duration_s, per_origin_s=per_origin_s, rng=rng)
    with tempfile.TemporaryDirectory(prefix="scex-sumo-") as folder:
        net, routes, fcd = (Path(folder) / name for name in ("map.net.xml", "traffic.rou.xml", "fcd.csv"))
        write_curve_limits(net_path, net)
        write_trips(routes, trips)
        _simulate(net, routes, fcd, at_most=at_most, duration_s=duration_s, seed=int(rng.integers(2**31)))
        return _read(fcd, trips, round(duration_s / STEP_S) + 1)


def scene_at(
    recording: Recording, step: int, chosen: IntArray, *, name: str, location: str, future: int = FUTURE_STEPS
) -> SeedScene:
    """The seed scene of some of the vehicles at one moment.

    Args:
        recording: a SUMO run.
        step: the moment.
        chosen: (V,) which vehicles; all of them present for the last 10 steps.
        name: of the seed scene.
        location: of the map.
        future: number of later steps to keep.
    """
    tracks = [_track(recording, int(k), step, future) for k in chosen]
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
        source={"synthetic": "SUMO demand and car-following (EIDM)", "step": step},
    )


def _simulate(net: Path, routes: Path, fcd: Path, *, at_most: int, duration_s: float, seed: int) -> None:
    options = {
        "net-file": net,
        "route-files": routes,
        "fcd-output": fcd,
        "fcd-output.attributes": "x,y,angle,speed",
        "precision": 6,
        "begin": 0,
        "end": duration_s,
        "step-length": STEP_S,
        "seed": seed,
        "max-num-vehicles": at_most,
        "max-depart-delay": MAX_DELAY_S,
        "lanechange.duration": LANE_CHANGE_S,
        "time-to-teleport": TELEPORT_S,
        "time-to-teleport.remove": "true",
        "collision.action": "none",
        "xml-validation": "never",
        "no-step-log": "true",
        "no-warnings": "true",
    }
    home = Path(sumo.SUMO_HOME)
    command = [
        str(home / "bin" / "sumo"),
        *(word for key, value in options.items() for word in (f"--{key}", str(value))),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "SUMO_HOME": str(home)}
    )
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        raise SimulationError(f"{net.name}: SUMO cannot populate it ({said[0] if said else done.returncode})")


def _read(fcd: Path, trips: list[Trip], steps: int) -> Recording:
    front = np.full((steps, len(trips), 2), np.nan)
    angle = np.full((steps, len(trips)), np.nan)
    speed = np.full((steps, len(trips)), np.nan)
    with fcd.open(newline="") as file:
        for row in csv.DictReader(file, delimiter=";"):
            if not row["vehicle_id"]:
                continue  # nothing drives at this step
            at = round(float(row["timestep_time"]) / STEP_S), int(row["vehicle_id"])
            front[at] = float(row["vehicle_x"]), float(row["vehicle_y"])
            # SUMO angles: 0 = north, clockwise, degrees; ours: 0 = east, counter-clockwise.
            angle[at] = np.pi / 2 - np.radians(float(row["vehicle_angle"]))
            speed[at] = float(row["vehicle_speed"])
    return Recording(trips=trips, present=~np.isnan(speed), front=front, angle=angle, speed=speed)


def driven(recording: Recording) -> BoolArray:
    """(T, K) present, and at its place by nothing but driving."""
    moved = np.hypot(*np.moveaxis(np.diff(recording.front, axis=0), -1, 0))
    fine = recording.present.copy()
    fine[1:] &= ~(moved > recording.speed[1:] * STEP_S + JUMP_M)
    return fine


def steady(recording: Recording) -> BoolArray:
    """(T, K) driven for the last 10 steps and present before them."""
    fine = driven(recording)
    ready = fine.copy()
    for back in range(1, HISTORY_STEPS):
        ready[back:] &= fine[:-back]
    ready[HISTORY_STEPS:] &= recording.present[:-HISTORY_STEPS]
    ready[:HISTORY_STEPS] = False
    return ready


def _moments(
    recording: Recording, ready: BoolArray, vehicles: int, rng: np.random.Generator
) -> Iterator[tuple[int, IntArray]]:
    """Moments with enough vehicles in random order, those without surplus vehicles first, and a choice."""
    steps = np.arange(round(WARM_UP_S / STEP_S), len(ready) - FUTURE_STEPS)
    steps = rng.permutation(steps[ready[steps].sum(axis=1) >= vehicles])
    surplus = recording.present[steps].sum(axis=1) - vehicles
    for step in steps[np.argsort(surplus, kind="stable")][:MOMENTS_TRIED]:
        yield int(step), np.sort(rng.choice(np.flatnonzero(ready[step]), vehicles, replace=False))


def _track(recording: Recording, k: int, step: int, future: int) -> tuple[States, BoolArray]:
    """(11 + future,) states of a vehicle around a moment, and (future,) which of the later ones it drove."""
    broken = np.flatnonzero(~driven(recording)[:, k])
    first = int(broken[broken < step].max(initial=-1))
    if first < 0 or not recording.present[first, k]:
        first += 1  # else the vehicle was moved to where it is at that step
    run = int(broken[broken > step].min(initial=len(recording.present)))
    front = recording.front[first:run, k]
    driven_states = body_states(front, float(recording.angle[first, k]), recording.trips[k].length_m)
    last = min(run, step + future + 1)
    kept = driven_states[step - HISTORY_STEPS - first : last - first]
    missing = step + future + 1 - last
    ahead = STEP_S * np.arange(1, missing + 1) * kept.speed[-1]
    heading = np.full(missing, kept.heading[-1])
    onwards = States(
        x=kept.x[-1] + ahead * np.cos(heading),
        y=kept.y[-1] + ahead * np.sin(heading),
        heading=heading,
        speed=np.full(missing, kept.speed[-1]),
    )
    valid = np.arange(step + 1, step + future + 1) < last
    return States.concatenate([kept, onwards], 0), valid


def _overlap(scene: SeedScene) -> bool:
    """Whether any two vehicles ever share ground from a second before the moment to 3 s after it.

    SUMO looks for collisions along lanes only; where a net's junctions hide a conflict, cars pass through
    each other.
    """
    assert scene.future is not None
    states = States.concatenate([scene.history, scene.future[:, :CHECKED_STEPS]], 1)[:, ::CHECKED_STRIDE]
    i, j = np.triu_indices(scene.vehicles, 1)
    steps = states.shape[1]
    gap = rectangle_distance(
        dx=(states.x[j] - states.x[i]).ravel(),
        dy=(states.y[j] - states.y[i]).ravel(),
        cos_1=np.cos(states.heading[i]).ravel(),
        sin_1=np.sin(states.heading[i]).ravel(),
        cos_2=np.cos(states.heading[j]).ravel(),
        sin_2=np.sin(states.heading[j]).ravel(),
        length_1=np.repeat(scene.length[i], steps),
        width_1=np.repeat(scene.width[i], steps),
        length_2=np.repeat(scene.length[j], steps),
        width_2=np.repeat(scene.width[j], steps),
    )
    return bool((gap <= 0.0).any())
