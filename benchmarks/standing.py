"""Standing vehicles: whether learned drivers stop behind one, with and without the guard, on a straight road.

A vehicle comes at constant speed; another one stands so far ahead, and stays. The smallest gap within 10 s,
bumper to bumper, m; negative where the driver ran into it. The training data have nothing of the kind.

    OMP_NUM_THREADS=1 python benchmarks/standing.py [MODEL ...]
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from scex_sumo.behaviors.base import Behavior
from scex_sumo.behaviors.registry import build, parse_models
from scex_sumo.extrapolation.loop.rollout import history_at
from scex_sumo.road import Lane, Road
from scex_sumo.scene import SceneHistory, SeedScene, States, VehicleIndex

MODELS = (
    "graph_predictor",
    "graph_image_predictor",
    "graph_predictor:guard=true",
    "graph_image_predictor:guard=true",
)
CASES = ((5.0, 15.0), (5.0, 30.0), (10.0, 15.0), (10.0, 30.0), (10.0, 50.0), (13.0, 30.0), (13.0, 50.0))
START_M, LENGTH_M, STEPS, REPLAN = 50.0, 4.5, 100, 5


def straight_road() -> Road:
    line = np.array([(0.0, 0.0), (600.0, 0.0)])
    side = np.array([0.0, 1.75])
    lane = Lane(
        lane_id=1,
        centreline=line,
        left_bound=line + side,
        right_bound=line - side,
        width_m=3.5,
        speed_limit_mps=13.9,
    )
    return Road(name="straight", lanes={1: lane})


def scene_of(speed: float, gap: float) -> SeedScene:
    back = 0.1 * np.arange(-10, 1)
    zeros = np.zeros((2, 11))
    x = np.stack([START_M + speed * back, np.full(11, START_M + gap + LENGTH_M)])
    return SeedScene(
        name="standing",
        location="straight",
        time_s=0.0,
        track_ids=np.array([1, 2]),
        types=("car", "car"),
        length=np.full(2, LENGTH_M),
        width=np.full(2, 1.8),
        history=States(x=x, y=zeros, heading=zeros, speed=zeros + np.array([[speed], [0.0]])),
        recorded_steps=np.full(2, 10),
    )


def smallest_gap(model: Behavior, road: Road, scene: SeedScene) -> float:
    history: SceneHistory = history_at(
        scene, scene.history.repeat(1), np.zeros(1, dtype=np.int64), np.zeros((1, 2)), step=0
    )
    driver = VehicleIndex(future=np.zeros(1, dtype=np.int64), vehicle=np.zeros(1, dtype=np.int64))
    standing = scene.now[1:]
    smallest = np.inf
    for step in range(STEPS):
        if step % REPLAN == 0:
            plan = model.plan(history, road, driver, [np.random.default_rng(0)])
            planned = States(x=plan.x, y=plan.y, heading=plan.heading, speed=plan.speed)
        now = States.concatenate([planned[:, step % REPLAN], standing], axis=0)
        states = States.concatenate([history.states[:, :, 1:], now[None, :, None]], axis=2)
        history = replace(history, states=states, step=step + 1)
        smallest = min(smallest, float(standing.x[0] - now.x[0]) - LENGTH_M)
    return smallest


def main() -> None:
    road = straight_road()
    print(f"{'speed, gap at first':36s}" + "".join(f"{v:g} m/s, {g:g} m".rjust(14) for v, g in CASES))
    for name in sys.argv[1:] or MODELS:
        model = build(parse_models(name)[0])
        gaps = [smallest_gap(model, road, scene_of(*case)) for case in CASES]
        print(f"{name:36s}" + "".join(f"{gap:14.1f}" for gap in gaps))


if __name__ == "__main__":
    main()
