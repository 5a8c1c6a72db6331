"""Agent steps of the vector environment in a minute of processor time, and what the example learns.

python benchmarks/environment.py [--models rules likely]
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from pathlib import Path

import gymnasium
import numpy as np

import scex_sumo as scex
from scex_sumo.environment import SEED_ENV

COUNT, STEPS = 385, 150


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--models", nargs="*", default=["rules", "likely"])
    scene = scex.read_seed(scex.example_path("roundabout"))
    for models in parser.parse_args().models:
        envs = gymnasium.make_vec(SEED_ENV, num_envs=COUNT, seed_scene=scene, models=models)
        envs.reset(seed=0)
        actions = envs.action_space
        actions.seed(0)
        began = time.process_time()
        for _ in range(STEPS):
            envs.step(actions.sample())
        rate = COUNT * STEPS / (time.process_time() - began) * 60
        print(f"{models}: {rate:,.0f} agent steps a minute of processor time")
    path = Path(__file__).resolve().parents[1] / "docs/examples/train_agent.py"
    spec = importlib.util.spec_from_file_location("train_agent", path)
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    for agent in (8, 9, 11):
        envs = gymnasium.make_vec(
            SEED_ENV, num_envs=COUNT, seed_scene=scene, agent=agent, observation="dict", hold=2
        )
        began = time.process_time()
        weights = example.train(envs)
        spent = time.process_time() - began
        before, after = example.mean_return(envs, np.zeros_like(weights)), example.mean_return(envs, weights)
        print(f"vehicle {agent}: mean return {before:.2f} -> {after:.2f}, {spent:.0f} s of processor time")


if __name__ == "__main__":
    main()
