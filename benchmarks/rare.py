"""Rare collisions by importance sampling against 60 000 plain futures, on recorded scenes.

    python benchmarks/rare.py [DATA] [--plain 60000] [--repeats 10] [--kept FILE]
    python benchmarks/rare.py --analytic 200

Columns: P of the plain futures with Wilson's interval; then for runs of 117 futures with different seeds and
extra futures: mean estimate, its standard deviation over that of as many plain futures, how many of the
intervals hold P, the medians of their upper limits and of what least gaps extrapolate to, and the processor
time of the extra futures over that of a run with human-like reference and report. ``--kept`` keeps the count
of the plain futures in a file.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.special import ndtr, ndtri

import scex_sumo
from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.models.population import uniforms
from scex_sumo.behaviors.registry import build, parse_models
from scex_sumo.extrapolation.assignments import child_generator, route_draws
from scex_sumo.extrapolation.engine import add_reference
from scex_sumo.extrapolation.rollout import Batch, roll_out
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.collisions import CONTACT_M2, find_collisions
from scex_sumo.reports.page.report import write_report
from scex_sumo.results.rare import probability_words
from scex_sumo.results.run import Run
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, SeedScene, States
from scex_sumo.statistics.collision_search import sample_rare
from scex_sumo.statistics.density import wilson
from scex_sumo.statistics.importance import Outcomes
from scex_sumo.world.plain import PlainWorld

CHECKED = (("Peach-3_2", 0.25), ("Peach-2_1", 0.25), ("Lanker-2_16", 0.5))
"""Recordings of NGSIM, and shares of their time."""
DRIVERS = "likely"
EXTRA = (27, 1000)
OTHERS_M = 0.05  # what another vehicle changes in the gap of a pair: as in recorded scenes
SEED, STEPS, REPLAN = 4711, 30, 5
VEHICLES_AT_ONCE = 6000


def scene_of(data: Path, part: str, share: float) -> SeedScene:
    recording = next(r for r in scex_sumo.find_recordings([data / "ngsim"]) if part in r.name)
    loaded = scex_sumo.load_recording(recording)
    times = [moment.time_s for moment in scex_sumo.recording_moments(loaded, every_s=1.0)]
    return scex_sumo.seed_at(loaded, times[int(share * len(times))])


def collisions(scene: SeedScene, first: int, count: int) -> int:
    """Number of plain futures with a collision."""
    road, (spec,) = scene.road, parse_models(DRIVERS)
    assert road is not None
    children = range(first, first + count)
    batch = Batch(
        children=np.array(children),
        assignment=np.zeros((count, scene.vehicles), dtype=np.int64),
        models=(build(spec),),
        names=(DRIVERS,),
        overridden=np.array([True]),
        route_draw=route_draws(children, scene.vehicles, seed=SEED),
        generators=[child_generator(SEED, child) for child in children],
    )
    world = PlainWorld(count, scene.vehicles)
    rollout = roll_out(world, road, scene, batch, steps=STEPS, replan=REPLAN)
    past = scene.history.repeat(count)[:, :, -LOGGED_HISTORY:].swapaxes(1, 2)
    tracks = SceneTracks(
        states=States.concatenate([past, rollout.states], axis=1),
        length=scene.length,
        width=scene.width,
        present=None,
        step_s=STEP_S,
        first=past.shape[1],
        types=scene.types,
    )
    return int(find_collisions(tracks, limit_m2=CONTACT_M2).any_of(count).sum())


def plain(scene: SeedScene, part: str, count: int, kept: Path | None) -> tuple[int, int]:
    """Number of plain futures with a collision, and of all."""
    known = json.loads(kept.read_text()) if kept is not None and kept.is_file() else {}
    hits, done = known.get(part, (0, 0))
    while done < count:
        size = min(VEHICLES_AT_ONCE // scene.vehicles, count - done)
        hits, done = hits + collisions(scene, done, size), done + size
        if kept is not None:
            kept.write_text(json.dumps(known | {part: (hits, done)}))
    return hits, done


def row(scene: SeedScene, p: float, extra: int, repeats: int) -> tuple[str, ...]:
    """Mean, spread, coverage, upper limit and cost of the estimates with so many extra futures."""
    found, spent = [], dict.fromkeys((0, extra), 0.0)
    with tempfile.TemporaryDirectory() as folder, Workers(1) as pool:

        def timed(seed: int, rare: int) -> Run:
            begin = time.process_time()
            out = f"{folder}/{seed}_{rare}"
            run = scex_sumo.extrapolate(
                scene,
                models=DRIVERS,
                children=117,
                seed=seed,
                rare=rare,
                world="plain",
                metrics=["gap"],
                out=out,
            )
            spent[rare] = time.process_time() - begin
            return run

        for seed in range(repeats):
            run = timed(seed, extra)
            found.append(run.p_collision if run.rare is None else run.rare)
        timed(repeats - 1, 0)
        begin = time.process_time()
        whole = scex_sumo.extrapolate(scene, out=f"{folder}/whole")
        add_reference(whole, scene, "likely", RunSettings(), workers=pool, rare=0)
        write_report(whole, scene)
        cost = (spent[extra] - spent[0]) / (time.process_time() - begin)
    values = np.array([one.value for one in found])
    spread = values.std(ddof=1) / np.sqrt(p * (1 - p) / (117 + extra)) if p else np.nan
    holds = sum(one.low <= p <= one.high for one in found)
    return (
        probability_words(float(values.mean())),
        f"{spread:.2f}",
        f"{holds} of {repeats}",
        probability_words(float(np.median([one.high for one in found]))),
        f"{cost:.2f}",
        next((one.mostly() for one in found if getattr(one, "pairs", ())), "–"),
    )


class NormalGap:
    """Futures of two vehicles with four normal numbers each, and a third one that moves their normal gap."""

    def __init__(self, level: float) -> None:
        self._level = level

    def run(self, draw: FloatArray) -> Outcomes:
        third = OTHERS_M * ndtri(uniforms(draw[:, 2], 1)[:, 0])
        gap, none = self.pair_gaps(draw, draw[:, :2]) - third, np.zeros(len(draw), dtype=np.int64)
        return Outcomes(
            futures=len(draw),
            future=np.arange(len(draw)),
            first=none,
            second=none + 1,
            gap=np.maximum(gap, 0.0),
            collided=gap <= 0,
        )

    def pair_gaps(self, vehicles: object, draw: FloatArray) -> FloatArray:
        one, other = (ndtri(uniforms(draw[:, v], 1, v)[:, 0]) for v in (0, 1))
        return np.asarray(self._level - np.sqrt((1 - OTHERS_M**2) / 2) * (one - other))

    def first_plans(self, vehicles: IntArray, draw: FloatArray) -> FloatArray:
        numbers = [ndtri(uniforms(draw[:, k], 1, salt)) for k in range(len(vehicles)) for salt in range(4)]
        return np.concatenate(numbers, axis=1).reshape(len(draw), len(vehicles), 4)

    def features(self, pair: tuple[int, int], plans: FloatArray) -> FloatArray:
        return plans.reshape(len(plans), -1)


def analytic(repeats: int) -> None:
    """Print the same of two vehicles whose least gap is normal: P = Φ(-level)."""
    print("|P|extra futures|mean / P|spread|intervals that hold P|upper limit / P|")
    print("|---" * 6 + "|")
    for level in (2.0, 2.5, 3.1, 3.7):
        for extra in EXTRA:
            p, found = float(ndtr(-level)), []
            for seed in range(repeats):
                plain, futures = np.random.default_rng([seed, 0]).random((117, 3)), NormalGap(level)
                sampled = sample_rare(
                    futures,
                    plain,
                    futures.run(plain),
                    extra,
                    draws_any=np.ones(3, dtype=np.bool_),
                    rng=np.random.default_rng([seed, 1]),
                )
                found.append(sampled.probability())
            values = np.array([one.value for one in found])
            spread = values.std(ddof=1) / np.sqrt(p * (1 - p) / (117 + extra))
            held = np.mean([one.low <= p <= one.high for one in found])
            high = np.median([one.high for one in found]) / p
            print(
                f"|{probability_words(p)}|{extra}|{values.mean() / p:.2f}|{spread:.2f}|{held:.0%}|{high:.3g}|"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")
    parser.add_argument("data", type=Path, nargs="?", default=default)
    parser.add_argument("--plain", type=int, default=60_000)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--only", help="part of a scene's name")
    parser.add_argument(
        "--analytic", type=int, metavar="REPEATS", help="of an example in closed form, instead"
    )
    options = parser.parse_args()
    if options.analytic:
        analytic(options.analytic)
        return
    print("|scene|vehicles|plain futures: P|extra futures|mean|spread|intervals that hold P", end="")
    print("|upper limit|cost|of the first run|")
    print("|---" * 10 + "|")
    for part, share in CHECKED:
        if options.only and options.only not in part:
            continue
        scene = scene_of(options.data, part, share)
        hits, count = plain(scene, part, options.plain, options.kept)
        truth = wilson(hits, count)
        limits = f"{probability_words(truth.low)} – {probability_words(truth.high)}"
        given = (part, str(scene.vehicles), f"{probability_words(truth.value)} ({limits})")
        for extra in EXTRA if options.repeats else ():
            print(
                "|" + "|".join((*given, str(extra), *row(scene, truth.value, extra, options.repeats))) + "|"
            )


if __name__ == "__main__":
    main()
