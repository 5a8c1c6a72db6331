"""Train a linear driver with the cross-entropy method: each of 385 futures tries other weights.

python train_agent.py [SEED.osm TRACK]
"""

import sys

import gymnasium
import numpy as np

import scex_sumo as scex
from scex_sumo.environment import SEED_ENV


def features(seen):
    """Return (N, F) few numbers of an observation, each of about 1."""
    path, speed = seen["path"] / 30.0, seen["history"][:, -1, 4] / 15.0
    near = seen["neighbours"][:, :3, -1] * seen["neighbour_mask"][:, :3, None] / [30.0, 30.0, 1.0, 1.0, 15.0]
    parts = path[:, 1::3].reshape(len(path), -1), near.reshape(len(path), -1), speed[:, None]
    return np.concatenate([*parts, np.ones((len(path), 1))], axis=1)


def returns(envs, weights, seed):
    """Return (N,) sums of rewards of one episode; (N, F, 2) weights drive one future each."""
    seen, _ = envs.reset(seed=seed)
    total, running = np.zeros(envs.num_envs), np.ones(envs.num_envs, dtype=bool)
    while running.any():
        action = np.tanh(np.einsum("nf,nfa->na", features(seen), weights))
        seen, reward, terminated, truncated, _ = envs.step(action)
        total += reward * running
        running &= ~(terminated | truncated)
    return total


def train(envs, rounds=30, seed=1):
    """Return (F, 2) weights after some rounds of the cross-entropy method."""
    rng = np.random.default_rng(seed)
    mean = np.zeros((features(envs.reset(seed=0)[0]).shape[1], 2))
    spread = np.full(mean.shape, 0.5)
    for number in range(rounds):
        tried = mean + spread * rng.standard_normal((envs.num_envs, *mean.shape))
        best = tried[np.argsort(returns(envs, tried, seed=number))[-envs.num_envs // 8 :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.02
    return mean


def mean_return(envs, weights, seed=10_000):
    """Return the mean return of all futures with drivers that training never met."""
    return returns(envs, np.broadcast_to(weights, (envs.num_envs, *weights.shape)), seed).mean()


if __name__ == "__main__":
    seed, track = sys.argv[1:] or (scex.example_path("roundabout"), 11)
    options = {"seed_scene": scex.read_seed(seed), "agent": int(track), "observation": "dict", "hold": 2}
    envs = gymnasium.make_vec(SEED_ENV, num_envs=385, **options)
    trained = train(envs)
    print(f"mean return untrained {mean_return(envs, np.zeros_like(trained)):.2f}", end=", ")
    print(f"trained {mean_return(envs, trained):.2f}")
