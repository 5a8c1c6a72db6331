"""How many vehicles collide in 10 s of closed loop, with the guard and without it?

    python benchmarks/guard.py [--data FOLDER] [--models MODEL,...] [--part test] [--every 10] [--most 40]

All vehicles of a scene are driven by one model, replanned every 0.5 s, in a world without SUMO. Scenes are
moments of the recordings of TAF-BW and MONA in a part of the time split (``--data``, else SCEX_DATA, else
../shared/data), and the three examples with vehicles that SUMO put there. Reported per data set:

- collide: vehicles whose rectangle overlaps another one's at any step, those that did at the start left out;
- speed: mean speed against the same model without guard;
- braking: vehicles that at any step brake harder than 6 m/s².

``--replayed`` counts instead how often the default guard brakes a replayed vehicle harder than 3 m/s² in the
half second after a moment. Vehicles whose recording brakes so hard or leaps are left out.

``--cost`` measures the guard's processor time per vehicle and plan instead: 11 vehicles, 64 futures that
have come apart by some 0.3 m, best of 20.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from driven import drive_scene, overlaps
from recorded_scenes import SETS, recorded

from scex_sumo.behaviors.models.simple import Replay, ReplayProfile
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.drivers.registry import build, parse_models
from scex_sumo.evaluation.recordings import load_recording, recording_moments, seed_at
from scex_sumo.extrapolation.loop.rollout import history_at
from scex_sumo.generators.populated import synthetic_seed
from scex_sumo.humans.guard.corridors import GuardProfile
from scex_sumo.humans.guard.guarded import Guarded, slowed
from scex_sumo.scene import STEP_S, SceneHistory, SeedScene, VehicleIndex

REPOSITORY = Path(__file__).resolve().parents[1]
MODELS = "constant_velocity,standard_driver,risky_driver,calibrated_driver"
EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")
HARD_MPS2 = 6.0
STEPS = 100


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Of one scene: (V,) per vehicle."""

    counts: np.ndarray
    collides: np.ndarray
    brakes_hard: np.ndarray
    speed: np.ndarray


def examples(vehicles: int = 12, count: int = 4) -> Iterator[SeedScene]:
    """Our own maps, populated by SUMO."""
    for name in EXAMPLES:
        for seed in range(count):
            yield synthetic_seed(REPOSITORY / f"scenarios/data/{name}.osm", vehicles=vehicles, seed=seed)


def outcome(scene: SeedScene, model: str) -> Outcome:
    driven = drive_scene(scene, model, steps=STEPS)
    hits = overlaps(driven, scene.length, scene.width)
    change = np.diff(driven.speed, axis=1) / STEP_S
    return Outcome(
        counts=~hits[:, :, 0].any(axis=1),
        collides=hits.any(axis=(1, 2)),
        brakes_hard=(change < -HARD_MPS2).any(axis=1),
        speed=driven.speed.mean(axis=1),
    )


def cost() -> None:
    """Print what the guard costs on top of the model."""
    scene = synthetic_seed(REPOSITORY / "scenarios/data/urban_intersection.osm", vehicles=11, seed=0)
    assert scene.road is not None
    futures, rng = np.arange(64), np.random.default_rng(0)
    whole, shape = scene.history.repeat(64), (64, scene.vehicles)
    window = dataclasses.replace(
        whole,
        x=whole.x + rng.normal(0, 0.3, (*shape, 1)),
        y=whole.y + rng.normal(0, 0.3, (*shape, 1)),
    )
    future, vehicle = np.indices(shape).reshape(2, -1)
    who = VehicleIndex(future=future, vehicle=vehicle)
    model = build(parse_models("constant_velocity")[0])
    spent = []
    for _ in range(20):
        # A new history each time, for what others are expected to do is remembered for one.
        history = history_at(scene, window, futures, np.full(shape, 0.5), step=5)
        plan = model.plan(history, scene.road, who, [])
        begin = time.process_time()
        slowed(plan, history, scene.road, who, GuardProfile())
        spent.append(time.process_time() - begin)
    print(f"guard: {1e6 * min(spent) / len(who):.1f} us per vehicle and plan")


def replayed(data: Path) -> None:
    """Print for how many recorded vehicle-seconds the guard brakes hard."""
    model = Replay(ReplayProfile())
    guarded = Guarded(model, GuardProfile())
    for name in (*SETS, "ngsim", "av2", "scenarionet"):
        count = hard = 0
        for recording in find_recordings([data / name]):
            loaded = load_recording(recording)
            for moment in recording_moments(loaded, every_s=1.0):
                scene = seed_at(loaded, moment.time_s)
                if scene.future_valid is None or scene.future_valid.shape[1] < 30:
                    continue
                vehicle = np.flatnonzero(scene.future_valid[:, :30].all(axis=1) & (scene.recorded_steps >= 5))
                if not len(vehicle):
                    continue
                who, now = (
                    VehicleIndex(future=np.zeros_like(vehicle), vehicle=vehicle),
                    scene.now.speed[vehicle],
                )
                history, road = SceneHistory.of_scene(scene), scene.road
                assert road is not None
                raw, made = (one.plan(history, road, who, []) for one in (model, guarded))
                smooth = np.abs(np.diff(raw.speed[:, :5], axis=1, prepend=now[:, None])).max(axis=1) < 0.5
                less = made.speed[:, 4] - now < -1.5
                hard += int((less & smooth & (raw.speed[:, 4] - now >= -1.5)).sum())
                count += int(smooth.sum())
        print(
            f"{name}: {hard / 2:g} of {count / 2:g} vehicle-seconds, {hard / max(count, 1):.2%}", flush=True
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("SCEX_DATA", "../shared/data")))
    parser.add_argument("--models", default=MODELS)
    parser.add_argument("--part", default="test", choices=("train", "validation", "test"))
    parser.add_argument("--every", type=float, default=10.0, help="least time between two moments, s")
    parser.add_argument("--most", type=int, default=40, help="most moments of a recording")
    parser.add_argument("--cost", action="store_true", help="measure the processor time instead")
    parser.add_argument(
        "--replayed", action="store_true", help="count hard braking of recorded people instead"
    )
    arguments = parser.parse_args()
    if arguments.replayed:
        replayed(arguments.data)
        return
    if arguments.cost:
        cost()
        return
    sets = {
        name: list(recorded(folder, arguments.part, every_s=arguments.every, most=arguments.most))
        for name, folder in ((name, arguments.data / name) for name in SETS)
        if folder.is_dir()
    }
    sets["examples"] = list(examples())
    print(f"{'data':10} {'model':36} {'scenes':>6} {'vehicles':>8} {'collide':>8} {'speed':>7} "
          f"{'braking':>8} {'CPU s':>6}")  # fmt: skip
    for name, scenes in sets.items():
        for model in arguments.models.split(","):
            raw = np.nan
            for guard in ("", ":guard=true"):
                begin = time.process_time()
                results = [outcome(scene, f"{model}{guard}") for scene in scenes]
                spent = time.process_time() - begin
                counts = np.concatenate([r.counts for r in results])
                collides = np.concatenate([r.collides for r in results])[counts].mean()
                hard = np.concatenate([r.brakes_hard for r in results])[counts].mean()
                speed = np.concatenate([r.speed for r in results])[counts].mean()
                raw = speed if not guard else raw
                print(f"{name:10} {model + guard:36} {len(scenes):6} {counts.sum():8} {collides:8.2%} "
                      f"{speed / raw:7.1%} {hard:8.2%} {spent:6.1f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
