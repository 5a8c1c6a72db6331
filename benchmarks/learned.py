"""What the learned drivers cost: ms per future, from graph to plan, without SUMO and metrics.

All vehicles of all futures on one learned driver, 3 s in closed loop with a plan every 0.5 s, in a world
that holds what it is told. CPU time of this process, the fastest of some repetitions after a first one.

    OPENBLAS_NUM_THREADS=1 python benchmarks/learned.py [MAP.osm] [--futures 64] [--vehicles 11] [--noise]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import scex_sumo as scex
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.registry import build, parse_models
from scex_sumo.extrapolation.loop.rollout import Batch, history_at, roll_out
from scex_sumo.learned import driver
from scex_sumo.learned.network.architecture import Architecture, shapes
from scex_sumo.learned.network.weights import save_weights
from scex_sumo.scene import SeedScene, States, VehicleIndex
from scex_sumo.world.plain import PlainWorld

MODELS = {"graph_predictor": "graph", "graph_image_predictor": "hybrid", "joint_predictor": "joint"}
PARTS = ("scene_graph", "path_inputs", "network", "plan_along", "the rest")
GOAL_MS = {"graph_predictor": 5.0, "graph_image_predictor": 10.0, "joint_predictor": 20.0}


class Watch:
    """CPU time of named parts; inner parts are taken off the outer ones."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.open: list[str] = []
        self.last = time.process_time()

    def switch(self) -> None:
        now = time.process_time()
        if self.open:
            self.seconds[self.open[-1]] += now - self.last
        self.last = now

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **keywords: Any) -> Any:
            self.switch()
            self.open.append(name)
            try:
                return function(*args, **keywords)
            finally:
                self.switch()
                self.open.pop()

        return timed


def first_vehicles(scene: SeedScene, count: int) -> SeedScene:
    """The scene with its first vehicles only."""
    if scene.vehicles < count:
        raise SystemExit(f"{scene.name} has {scene.vehicles} vehicles, not {count}")
    return scene.reordered(range(count), name=scene.name)


def futures_of(scene: SeedScene, model: Any, count: int) -> Batch:
    rng = np.random.default_rng(0)
    return Batch(
        futures=np.arange(count),
        assignment=np.zeros((count, scene.vehicles), dtype=np.int64),
        models=[model],
        names=["learned"],
        overridden=np.ones(1, dtype=np.bool_),
        route_draw=rng.random((count, scene.vehicles)),
        generators=[np.random.default_rng(c) for c in range(count)],
    )


def untrained(folder: Path, name: str) -> str:
    file, kind, sizes, rng = folder / name, MODELS[name], Architecture(), np.random.default_rng(0)
    state = {name: rng.uniform(-0.1, 0.1, shape) for name, shape in shapes(kind, sizes).items()}
    state |= {name: np.ones_like(values) for name, values in state.items() if name.endswith(".spread")}
    save_weights(file, kind, sizes, state, {})
    return str(file)


def measured(scene: SeedScene, text: str, futures: int, repeat: int) -> tuple[dict[str, float], float]:
    """CPU seconds of each part, those of the fastest repetition; and of the very first plan."""
    model: Any = build(parse_models(text)[0])
    cast = futures_of(scene, model, futures)
    assert scene.road is not None
    plan, predict = model.plan, model.driver.predict
    begin = time.process_time()
    roll_out(PlainWorld(futures, scene.vehicles), scene.road, scene, cast, steps=1, replan=5)
    first = time.process_time() - begin
    found = []
    originals = {name: getattr(driver, name) for name in ("scene_graph", "path_inputs", "plan_along")}
    for _ in range(repeat):
        watch = Watch()
        for name, function in originals.items():
            setattr(driver, name, watch.around(name, function))
        model.driver.predict = watch.around("network", predict)
        model.plan = watch.around("the rest", plan)
        roll_out(PlainWorld(futures, scene.vehicles), scene.road, scene, cast, steps=30, replan=5)
        found.append(watch.seconds)
    for name, function in originals.items():
        setattr(driver, name, function)
    return min(found, key=lambda seconds: sum(seconds.values())), first


def order_noise(scene: SeedScene, text: str, futures: int) -> float:
    """How much predictions before rounding depend on who shares the batch, m/s² or m."""
    model: Any = build(parse_models(text)[0])
    rng = np.random.default_rng(1)
    spread = [rng.normal(0, s, (futures, scene.vehicles, 1)) for s in (1.0, 1.0, 0.05, 0.5)]
    parts = [scene.history.x, scene.history.y, scene.history.heading, scene.history.speed]
    x, y, heading, speed = (part + move for part, move in zip(parts, spread, strict=True))
    states = States(x=x, y=y, heading=heading, speed=np.maximum(speed, 0.0))

    def predicted(some: slice) -> list[np.ndarray]:
        numbers = np.arange(futures)[some]
        history = history_at(scene, states[some], numbers, np.zeros((len(numbers), scene.vehicles)), step=5)
        future, vehicle = np.indices(history.now.shape).reshape(2, -1)
        who = VehicleIndex(future=future, vehicle=vehicle)
        paths, row = chosen_paths(history, scene.road, who, "straight")
        _, modes = model.driver.predict(history, scene.road, who, paths, row)
        return [part.reshape(len(numbers), -1) for part in modes if part is not None]

    whole, largest = predicted(slice(None)), 0.0
    for size in (1, 3, 7, 13):
        for first in range(0, futures, size):
            for one, other in zip(predicted(slice(first, first + size)), whole, strict=True):
                largest = max(largest, float(np.abs(one - other[first : first + size]).max()))
    return largest


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("map", nargs="?", default=str(scex.example_path("urban_intersection")))
    parser.add_argument("--tracks")
    parser.add_argument("--time", type=float)
    parser.add_argument("--futures", type=int, default=64)
    parser.add_argument("--vehicles", type=int, default=11)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--untrained", action="store_true", help="random weights instead of the shipped ones")
    parser.add_argument("--noise", action="store_true", help="how much predictions depend on the batch")
    given = parser.parse_args()
    scene = first_vehicles(scex.read_seed(given.map, tracks=given.tracks, time=given.time), given.vehicles)
    print(f"{scene.name}: {given.futures} futures of {scene.vehicles} vehicles, 6 plans each, ms per future")
    print(
        f"{'':24s}"
        + "".join(f"{part:>13s}" for part in PARTS)
        + f"{'all':>9s}{'goal':>7s}{'first plan':>13s}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in MODELS:
            text = f"{name}:mode=draw:path=likeliest"
            text += f":weights={untrained(Path(folder), name)}" if given.untrained else ""
            seconds, first = measured(scene, text, given.futures, given.repeat)
            each = [1e3 * seconds[part] / given.futures for part in PARTS]
            print(
                f"{name:24s}"
                + "".join(f"{ms:13.3f}" for ms in each)
                + f"{sum(each):9.2f}{GOAL_MS[name]:7.0f}"
                f"{first:11.2f} s"
            )
            if given.noise:
                noise = order_noise(scene, text, given.futures)
                print(f"{'':24s}batches of 1, 3, 7, 13 change predictions by at most {noise:.1e}")


if __name__ == "__main__":
    main()
