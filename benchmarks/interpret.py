"""INTERPRET's measures of six futures on the test parts of INTERACTION's recordings.

    python benchmarks/interpret.py [--data FOLDER] [--every SECONDS] [MODEL...]

MODEL: as in `run --models`, for example joint_predictor:weights=FILE:mode=draw. INTERPRET's own cases are
not part of the recordings, so a case is a moment of the last fifth of a recording: 1 s is seen, 3 s are
predicted. Its vehicles are those seen all the time; one of them, drawn, is the ego, which no measure counts.

Measures as published with the challenge (github.com/interaction-dataset, INTERPRET_challenge_multi-agent and
-single-agent): the best of six futures for each vehicle alone (minADE, minFDE, MR), the best for all vehicles
of a case together (minJointADE, minJointFDE, minJointMR, and Consistent-minJointMR among futures without a
collision), the share of futures in which two vehicles collide (CrossCollisionRate), the share of cases in
which all six collide with the recorded ego (EgoCollisionRate). Vehicles collide if circles along their
middle come nearer than the sum of their widths over the root of 3.8.
"""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import predictors_measures as measures
from predictors import data_root

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS, Behavior
from scex_sumo.behaviors.registry import ModelSpec, build, model_specs
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.learned.training.data.samples import learnable
from scex_sumo.scene import SeedScene, States

MODELS = (
    "constant_velocity",
    "likely_driver",
    "graph_predictor:path=likeliest:mode=draw",
    "joint_predictor:mode=draw",
)
COLUMNS = (
    *("minADE", "minFDE", "MR", "minJointADE", "minJointFDE", "minJointMR"),
    *("Consistent-minJointMR", "CrossCollisionRate", "EgoCollisionRate"),
)
SHORT_M, LONG_M = 4.0, 8.0  # lengths between which a vehicle has three circles; a longer one has five
CIRCLES = {
    2: (-1.0, 1.0),
    3: (-1.0, 0.0, 1.0),
    5: (-1.0, -0.5, 0.0, 0.5, 1.0),
}  # of half of length less width


def cases(roots: Sequence[Path], every_s: float) -> Iterator[tuple[measures.TestScene, IntArray, int]]:
    """Yield cases with the vehicles that are predicted, and the ego."""
    for recording in find_recordings(roots):
        for test in measures.test_scenes(recording, every_s):
            vehicle = learnable(test.scene)
            if len(vehicle) > 1:
                ego = np.random.default_rng(zlib.crc32(test.scene.name.encode())).integers(len(vehicle))
                yield test, np.delete(vehicle, ego), int(vehicle[ego])


def figures(scene: SeedScene, made: States, vehicle: IntArray, ego: int) -> FloatArray:
    """Return `COLUMNS` of futures (6, V, T) of a case; vehicles (k,)."""
    assert scene.future is not None
    future = scene.future[:, :PLAN_STEPS]
    off = np.hypot(made.x[:, vehicle] - future.x[vehicle], made.y[:, vehicle] - future.y[vehicle])
    missed = measures.missed(future[vehicle, -1], made[:, vehicle, -1])
    one, two = (vehicle[k] for k in np.triu_indices(len(vehicle), 1))
    crossed = _touching(scene, made[:, one], made[:, two], one, two).any(axis=1)
    recorded = future[np.full_like(vehicle, ego)]
    hit = _touching(scene, made[:, vehicle], recorded, vehicle, np.full_like(vehicle, ego)).any(axis=1)
    share = missed.mean(axis=1)
    alone = (off.mean(axis=2).min(axis=0).mean(), off[..., -1].min(axis=0).mean(), missed.all(axis=0).mean())
    joint = (off.mean(axis=(1, 2)).min(), off[..., -1].mean(axis=1).min(), share.min())
    consistent = np.where(crossed, 1.0, share).min()
    return np.array([*alone, *joint, consistent, crossed.mean(), hit.all()])


def _touching(scene: SeedScene, one: States, two: States, i: IntArray, j: IntArray) -> BoolArray:
    """Return (6, k) whether the circles of pairs come too near at any step."""
    near = np.zeros(one.x.shape[:2], dtype=np.bool_)
    for k in range(len(i)):
        first, second = _circles(scene, one[:, k], i[k]), _circles(scene, two[..., k, :], j[k])
        apart = np.abs(first[..., :, None] - second[..., None, :]).min(axis=(-1, -2))
        near[:, k] = (apart < (scene.width[i[k]] + scene.width[j[k]]) / np.sqrt(3.8)).any(axis=-1)
    return near


def _circles(scene: SeedScene, states: States, vehicle: int) -> FloatArray:
    """Return (..., T, c) middles of the circles of a vehicle as complex numbers."""
    length = scene.length[vehicle]
    at = np.array(CIRCLES[2 if length < SHORT_M else 3 if length < LONG_M else 5])
    forward = np.exp(1j * states.heading)[..., None] * (length - scene.width[vehicle]) / 2
    return np.asarray(states.x[..., None] + 1j * states.y[..., None] + forward * at)


def measured(model: Behavior, replan: int, given: Sequence[tuple[measures.TestScene, IntArray, int]]) -> str:
    """Return the cells of a model: means over cases."""
    rows = []
    for test, vehicle, ego in given:
        futures = measures.drawn_futures(test, model, measures.GUESSES, replan)
        rows.append(figures(test.scene, futures.swapaxes(1, 2), vehicle, ego))
    return " | ".join(f"{value:.2f}" for value in np.mean(rows, axis=0))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", nargs="*", default=list(MODELS), metavar="MODEL")
    parser.add_argument("--data", type=Path, action="append", default=[])
    parser.add_argument("--every", type=float, default=15.0, help="s between two cases of a recording")
    given = parser.parse_args()
    every = list(cases(given.data or [data_root() / "interaction"], given.every))
    vehicles = sum(len(vehicle) for _, vehicle, _ in every)
    print(f"{len(every)} cases, {vehicles} vehicles\n\n| model | {' | '.join(COLUMNS)} |")
    print("|---|" + "---|" * len(COLUMNS))
    for text in given.models:
        (spec,) = model_specs(text)
        print(f"| {text} | {measured(build(spec), _replan(spec), every)} |", flush=True)


def _replan(spec: ModelSpec) -> int:
    # The plan of `joint_predictor` is what it drives in closed loop.
    return PLAN_STEPS if spec.name == "joint_predictor" else measures.REPLAN


if __name__ == "__main__":
    main()
