"""Fits calibrated_driver to recordings, and says how well it and others imitate people.

    python benchmarks/calibrate.py [--data FOLDER] [--evaluate-only]

Fitted on the training part of the time split of TAF-BW and MONA (``--data``, else SCEX_DATA, else
../shared/data), moving vehicles on the road, both sets weighing the same: the mean and the final error over
3 s along the path that the vehicle really took. Leaders, the formula and the desired speed are those of the
driver; only the steering is left out, so that thousands of vehicles are driven in one go. Nelder-Mead from
fixed starts, so that two runs print the same.

Then the figures of the validation and the test part, by the drivers' own plans along their own choice of
path: mean and final displacement error of moving vehicles (ADE, FDE), m. The test part was looked at once,
after everything else had been settled.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from recorded_scenes import SETS, recorded
from scipy.optimize import minimize

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import BatchBehavior
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.motion import CURVE_TIME_S
from scex_sumo.behaviors.driving.paths import BEHIND_M, DS_M, SeedPaths, expected_way, seed_paths
from scex_sumo.behaviors.models.idm import IdmProfile, desired_speed, idm_acceleration, seed_motion
from scex_sumo.drivers.registry import build, entry_of, parse_models
from scex_sumo.extrapolation.loop.rollout import history_at
from scex_sumo.scene import STEP_S, Plan, SceneHistory, SeedScene, VehicleIndex

STEPS = 30
MOVING_MPS = 0.5
AHEAD = 240  # samples of the path ahead of a vehicle, 120 m
OFF_PATH_M = 2.5  # a vehicle whose path is further off at any of the three seconds took none of them
MOST = 1500  # vehicles of each set to fit to
EVERY_S = {"taf_bw": 0.5, "mona": 2.0}
# Three seconds do not tell for how long a driver keeps to its habit, nor what it wants after that.
GIVEN = {"habit_memory": 30.0, "speed_factor": 1.0}
# least, most, and where the search starts: as one would guess people drive, and somewhere else
BOUNDS = {
    "time_headway": (0.5, 3.0, 1.2, 0.8),
    "minimum_gap": (1.0, 5.0, 2.0, 1.5),
    "max_acceleration": (0.3, 3.0, 1.5, 1.8),
    "comfort_deceleration": (0.5, 6.0, 2.0, 1.2),
    "curve_acceleration": (0.8, 5.0, 2.5, 3.5),
    "curve_deceleration": (0.2, 4.0, 1.0, 2.0),
    "habit_lead": (0.0, 5.0, 1.0, 1.5),
    "habit_margin": (0.0, 3.0, 0.5, 0.2),
}
MODELS = ("standard_driver", "risky_driver", "calibrated_driver", "constant_velocity")


@dataclass(frozen=True, kw_only=True)
class Samples:
    """n vehicles, each on the path that it took; arc lengths from where it is.

    Attributes:
        speed: (n,) in the seed scene, m/s.
        acceleration: (n,) there, m/s².
        gap: (n,) to the leader, m.
        leader_speed: (n,) m/s.
        limit: (n, AHEAD) along the path, m/s.
        curvature: (n, AHEAD) 1/m.
        way: (n, 30) that the vehicle really made, m.
    """

    speed: FloatArray
    acceleration: FloatArray
    gap: FloatArray
    leader_speed: FloatArray
    limit: FloatArray
    curvature: FloatArray
    way: FloatArray

    def part(self, chosen: IntArray) -> Samples:
        return Samples(**{f.name: getattr(self, f.name)[chosen] for f in dataclasses.fields(self)})


def present(scene: SeedScene) -> SceneHistory:
    draw = np.full((1, scene.vehicles), 0.5)
    return history_at(scene, scene.history.repeat(1), np.zeros(1, dtype=np.int64), draw, step=0)


def complete(scene: SeedScene) -> IntArray:
    """Moving vehicles on the road with 3 s of recorded future."""
    if scene.future is None or scene.future_valid is None or scene.future_valid.shape[1] < STEPS:
        return np.zeros(0, dtype=np.int64)
    whole = scene.future_valid[:, :STEPS].all(axis=1) & (scene.now.speed > MOVING_MPS)
    return np.flatnonzero(whole)


def path_taken(scene: SeedScene, paths: SeedPaths, vehicle: IntArray) -> tuple[IntArray, FloatArray]:
    """(k,) rows of the paths nearest to what was recorded, and (k,) how far off they are at most, m."""
    assert scene.future is not None
    count = paths.count[vehicle]
    owner = np.repeat(np.arange(len(vehicle)), count)
    row = np.concatenate([paths.first[v] + np.arange(paths.count[v]) for v in vehicle])
    off = np.zeros(len(row))
    for step in (9, 19, 29):
        x, y = scene.future.x[vehicle, step], scene.future.y[vehicle, step]
        way = BEHIND_M + scene.now.speed[vehicle] * (step + 1) * STEP_S
        off = np.maximum(off, np.abs(paths.foot_points(row, x[owner], y[owner], way[owner])[1]))
    order = np.lexsort((row, off, owner))
    best = order[np.unique(owner[order], return_index=True)[1]]
    return row[best], off[best]


def samples_of(scene: SeedScene, profile: IdmProfile) -> Samples | None:
    vehicle = complete(scene)
    if not len(vehicle):
        return None
    assert scene.road is not None and scene.future is not None
    paths = seed_paths(scene, scene.road)
    row, off = path_taken(scene, paths, vehicle)
    good = (off <= OFF_PATH_M) & paths.on_road[vehicle]
    vehicle, row = vehicle[good], row[good]
    history, vehicles = present(scene), VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
    now = scene.now[vehicle]
    s, _, _ = paths.foot_points(row, now.x, now.y, expected_way(history, vehicles))
    near = {"clearance": profile.clearance, "radius": profile.radius}
    leaders = find_leaders(history, vehicles, paths, row, s, **near)
    future = scene.future[vehicle]
    ways = [
        paths.foot_points(row, future.x[:, k], future.y[:, k], s + now.speed * (k + 1) * STEP_S)[0] - s
        for k in range(STEPS)
    ]
    ahead = np.clip((s / DS_M).astype(np.int64)[:, None] + np.arange(AHEAD), 0, paths.samples - 1)
    speed, acceleration = seed_motion(history, vehicles)
    return Samples(
        speed=speed,
        acceleration=acceleration,
        gap=leaders.gap,
        leader_speed=leaders.speed,
        limit=paths.speed_limit[row[:, None], ahead],
        curvature=paths.curve_curvature[row[:, None], ahead],
        way=np.stack(ways, axis=1).reshape(-1, STEPS),
    )


def drive(samples: Samples, profile: IdmProfile) -> FloatArray:
    """(n, 30) way of the driver along the path that was taken, as `IdmDriver` drives, without steering."""
    square = profile.curve_acceleration / np.maximum(samples.curvature, 1e-6)
    slope = 2 * profile.curve_deceleration * DS_M * np.arange(AHEAD)
    curves = np.sqrt(np.minimum.accumulate((square + slope)[:, ::-1], axis=1)[:, ::-1] - slope)
    i, v, x = np.arange(len(samples.speed)), samples.speed, np.zeros_like(samples.speed)
    ways = np.empty((len(v), STEPS))
    for step in range(STEPS):
        at = np.clip(x / DS_M, 0, AHEAD - 1).astype(np.int64)
        wished = profile.speed_factor * samples.limit[i, at]
        desired = desired_speed(profile, wished, v, samples.speed, samples.acceleration, step * STEP_S)
        gap = samples.gap + samples.leader_speed * (step * STEP_S) - x
        a = idm_acceleration(profile, v, desired, gap, samples.leader_speed)
        if profile.curve_acceleration > 0:
            soon = np.clip((x + v * CURVE_TIME_S) / DS_M, 0, AHEAD - 1).astype(np.int64)
            slowing = np.maximum((curves[i, soon] - v) / CURVE_TIME_S, -profile.comfort_deceleration)
            a = np.minimum(a, slowing)
        following = v + a * STEP_S
        x = x + np.where(following >= 0, (v + following) * (STEP_S / 2), v**2 / np.maximum(-2 * a, 1e-9))
        v = np.maximum(following, 0.0)
        ways[:, step] = x
    return ways


def errors(samples: Samples, ways: FloatArray) -> tuple[float, float]:
    """Mean and final error along the path, m."""
    off = np.abs(ways - samples.way)
    return float(off.mean()), float(off[:, -1].mean())


def fit(sets: Sequence[Samples], start: IdmProfile) -> IdmProfile:
    """The profile with the least sum of mean and final error, averaged over the sets."""
    low, high, *begins = np.array(list(BOUNDS.values())).T

    def profile_at(unit: FloatArray) -> IdmProfile:
        values = low + (high - low) * np.clip(unit, 0.0, 1.0)
        return dataclasses.replace(start, **dict(zip(BOUNDS, values.tolist(), strict=True)))

    def cost(unit: FloatArray) -> float:
        profile = profile_at(unit)
        outside = np.abs(unit - np.clip(unit, 0.0, 1.0)).sum()
        return float(np.mean([sum(errors(s, drive(s, profile))) for s in sets]) + outside)

    found = []
    for begin in begins:
        unit = (begin - low) / (high - low)
        steps = np.where(unit < 0.5, 0.25, -0.25)
        simplex = np.vstack([unit, unit + np.diag(steps)])
        options = {"maxfev": 600, "xatol": 5e-3, "fatol": 5e-4, "adaptive": True, "initial_simplex": simplex}
        found.append(minimize(cost, unit, method="Nelder-Mead", options=options))
        print(f"  cost {cost(unit):.4f} -> {found[-1].fun:.4f} m in {found[-1].nfev} evaluations", flush=True)
    return profile_at(min(found, key=lambda result: float(result.fun)).x)


class StraightOn:
    """Present speed and heading, without a path: what "constant velocity" means to those who predict."""

    def plan(
        self, history: SceneHistory, road: object, vehicles: VehicleIndex, rng: Sequence[np.random.Generator]
    ) -> Plan:
        now = history.now[vehicles.future, vehicles.vehicle]
        way = now.speed[:, None] * STEP_S * np.arange(1, STEPS + 1)
        x, y = (
            now.x[:, None] + way * np.cos(now.heading)[:, None],
            now.y[:, None] + way * np.sin(now.heading)[:, None],
        )
        heading, speed = (np.repeat(a[:, None], STEPS, axis=1) for a in (now.heading, now.speed))
        return Plan(x=x, y=y, heading=heading, speed=speed)


def displacement(scenes: Sequence[SeedScene], model: BatchBehavior) -> tuple[float, float, int]:
    """ADE and FDE of a model's own plans, m, and of how many vehicles."""
    off = []
    for scene in scenes:
        vehicle = complete(scene)
        if not len(vehicle):
            continue
        assert scene.road is not None and scene.future is not None
        vehicles = VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle)
        plan = model.plan(present(scene), scene.road, vehicles, [np.random.default_rng(0)])
        future = scene.future[vehicle]
        off.append(np.hypot(plan.x[:, :STEPS] - future.x[:, :STEPS], plan.y[:, :STEPS] - future.y[:, :STEPS]))
    every = np.concatenate(off)
    return float(every.mean()), float(every[:, -1].mean()), len(every)


def report(scenes: dict[str, dict[str, list[SeedScene]]]) -> None:
    print(f"\n{'part':10} {'data':7} {'model':18} {'vehicles':>8} {'ADE':>6} {'FDE':>6}")
    models: dict[str, BatchBehavior] = {name: build(parse_models(name)[0]) for name in MODELS}
    for part in ("validation", "test"):
        for name, parts in scenes.items():
            for model, built in {**models, "straight on": StraightOn()}.items():
                ade, fde, count = displacement(parts[part], built)
                print(f"{part:10} {name:7} {model:18} {count:8} {ade:6.2f} {fde:6.2f}", flush=True)


def training(scenes: dict[str, dict[str, list[SeedScene]]], start: IdmProfile) -> Iterator[Samples]:
    for name, parts in scenes.items():
        found = [s for s in (samples_of(scene, start) for scene in parts["train"]) if s is not None]
        joined = {
            f.name: np.concatenate([getattr(s, f.name) for s in found]) for f in dataclasses.fields(Samples)
        }
        whole = Samples(**joined)
        count = len(whole.speed)
        chosen = np.sort(np.random.default_rng(0).permutation(count)[:MOST])
        print(f"{name}: {count} vehicles to fit to, {len(chosen)} taken")
        yield whole.part(chosen)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("--evaluate-only", action="store_true", help="no fit, only the figures")
    parser.add_argument("--fit-only", action="store_true", help="no figures of validation and test")
    arguments = parser.parse_args()
    begin = time.process_time()
    wanted = [*([] if arguments.evaluate_only else ["train"]),
              *([] if arguments.fit_only else ["validation", "test"])]  # fmt: skip
    scenes = {
        name: {
            part: list(recorded(arguments.data / name, part, every_s=EVERY_S[name], min_history=10))
            for part in wanted
        }
        for name in SETS
    }
    if not arguments.evaluate_only:
        start = dataclasses.replace(entry_of("calibrated_driver").profile, **GIVEN)
        sets = list(training(scenes, start))
        fitted = fit(sets, start)
        for key in (*BOUNDS, *GIVEN):
            print(f"  {key} = {getattr(fitted, key):.2f}")
        for name, samples in zip(scenes, sets, strict=True):
            ade, fde = errors(samples, drive(samples, fitted))
            print(f"  {name}, training part, along the path taken: mean {ade:.2f} m, final {fde:.2f} m")
    if not arguments.fit_only:
        report(scenes)
    print(f"CPU {time.process_time() - begin:.0f} s")


if __name__ == "__main__":
    main()
