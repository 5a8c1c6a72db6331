"""Ordered pair-steps per second of the metrics on one core, per metric and in total.

    python benchmarks/metrics.py [--futures 385] [--vehicles 11] [--steps 30] [--repeats 5] [--memory]

*random* scatters vehicles over a square, so that every path may cross every other; *smooth* drives them on
straight and curved lanes through one intersection, as a run does.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.registry import METRICS
from scex_sumo.scene import STEP_S, States

HISTORY = 11
REPLAN = 5
PLANNED = 30


def drive(
    rng: np.random.Generator, start: FloatArray, speed: FloatArray, curvature: FloatArray, steps: int
) -> tuple[SceneTracks, PlannedPaths]:
    """Vehicles on circular arcs with slowly changing speed; their plans continue present speed and curvature.

    Args:
        rng: for accelerations and sizes.
        start: (3, C, V) x, y, heading.
        speed: (C, V) m/s.
        curvature: (C, V) 1/m.
        steps: evaluated steps.
    """
    shape = speed.shape
    total = HISTORY + steps
    acceleration = rng.normal(0, 1.0, shape)
    x, y, heading = start.copy()
    states = States.empty((shape[0], total, shape[1]))
    plans = []
    for step in range(total):
        states.assign(np.s_[:, step], States(x=x, y=y, heading=heading, speed=speed))
        since = step - (HISTORY - 1)
        if since >= 0 and since % REPLAN == 0 and since < steps:
            ahead = np.arange(1, PLANNED + 1) * STEP_S
            turned = heading[..., None] + curvature[..., None] * speed[..., None] * ahead
            moved = speed[..., None] * STEP_S
            plans.append(
                (
                    x[..., None] + np.cumsum(moved * np.cos(turned), -1),
                    y[..., None] + np.cumsum(moved * np.sin(turned), -1),
                )
            )
        speed = np.maximum(speed + acceleration * STEP_S, 0.0)
        heading = heading + curvature * speed * STEP_S
        x, y = x + speed * STEP_S * np.cos(heading), y + speed * STEP_S * np.sin(heading)
    length = rng.uniform(3.5, 6.0, shape[1])
    tracks = SceneTracks(states=states, length=length, width=0.4 * length, first=HISTORY)
    planned = PlannedPaths.from_replans(
        np.stack([p[0] for p in plans], 1),
        np.stack([p[1] for p in plans], 1),
        np.arange(0, steps, REPLAN),
        steps,
    )
    return tracks, planned


def random_scenes(futures: int, vehicles: int, steps: int) -> tuple[SceneTracks, PlannedPaths]:
    rng = np.random.default_rng(0)
    shape = (futures, vehicles)
    start = np.stack([*rng.uniform(0, 100, (2, *shape)), rng.uniform(-np.pi, np.pi, shape)])
    return drive(rng, start, rng.uniform(0, 20, shape), rng.normal(0, 0.02, shape), steps)


def smooth_scenes(futures: int, vehicles: int, steps: int) -> tuple[SceneTracks, PlannedPaths]:
    """One seed scene driven differently in every future: four arms of an intersection, rotated by 30°."""
    rng = np.random.default_rng(1)
    arm = np.arange(vehicles) % 4
    along = -15.0 - 14.0 * (np.arange(vehicles) // 4) - 3.0 * arm
    heading = np.pi / 6 + arm * np.pi / 2
    x = along * np.cos(heading) + 1.75 * np.sin(heading)
    y = along * np.sin(heading) - 1.75 * np.cos(heading)
    shape = (futures, vehicles)
    start = np.stack([np.broadcast_to(a, shape) for a in (x, y, heading)])
    speed = np.broadcast_to(rng.uniform(5, 12, vehicles), shape)
    return drive(rng, start, speed, rng.choice([0.0, 0.0, 0.02, -0.05], shape), steps)


def seconds(
    tracks: SceneTracks, planned: PlannedPaths, metrics: tuple[str, ...] | None, repeats: int
) -> float:
    """Processor time (of the one thread there is), best of some repetitions: other jobs do not count."""
    best = np.inf
    for _ in range(repeats):
        begin = time.process_time()
        evaluate(tracks, planned, metrics=metrics)
        best = min(best, time.process_time() - begin)
    return best


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--futures", type=int, default=385)
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--memory", action="store_true", help="print the peak memory beyond the inputs")
    options = parser.parse_args()
    pair_steps = options.futures * options.steps * options.vehicles * (options.vehicles - 1)
    size = f"{options.futures} futures x {options.steps} steps x {options.vehicles} vehicles"
    print(f"{size}: {pair_steps:,} ordered pair-steps")
    for name, make in (("random", random_scenes), ("smooth", smooth_scenes)):
        tracks, planned = make(options.futures, options.vehicles, options.steps)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for metric in (*METRICS, None):
            took = seconds(tracks, planned, None if metric is None else (metric,), options.repeats)
            rate = pair_steps / took / 1e6
            print(f"{name:8s}{metric or 'all six':10s}{took:8.3f} s {rate:8.2f} M pair-steps/s")
        if options.memory:
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            print(f"{name:8s}peak memory {peak / 2**20:.2f} GiB, inputs {before / 2**20:.2f} GiB")


if __name__ == "__main__":
    main()
