"""Truth of a suite's number: all candidates of a ranking in full, against suites of some of them.

    python benchmarks/suite_truth.py run RANKING full.jsonl
    python benchmarks/suite_truth.py judge RANKING full.jsonl

`run` drives three functions through every candidate with 64 futures, a line each; it goes on where it was
stopped. `judge` makes suites with other random seeds, and prints how often their intervals hold the rate of
all candidates, and how wide they are against those of as many candidates drawn equally.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import scex_sumo as scex
from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.motion import drive
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.driving.projection import expected_way, foot_points
from scex_sumo.drivers.registry import model_specs
from scex_sumo.suites.choice import choose
from scex_sumo.suites.cut import cutter_of, recordings_of
from scex_sumo.suites.estimate import rate
from scex_sumo.suites.population import Population, read_population
from scex_sumo.suites.simulate import simulate
from scex_sumo.suites.testing.tasks import record_of

KEPT = ("probability", "severity", "typical", "acting", "variance", "contacts", "struck", "others")


class Acc:
    """Adaptive cruise control that sees leaders on its straightest path, and nobody who crosses it."""

    def plan(self, history: Any, road: Any, who: Any, rng: Any) -> Any:
        """Keep the first speed, and 2 m with 1.8 s to the leader."""
        paths, row = chosen_paths(history, road, who, "straight")
        own = history.now[who.future, who.vehicle]
        s, _, _ = foot_points(paths, row, own.x, own.y, expected_way(history, who))
        far = {"clearance": 1.5, "radius": 100.0, "obstacle_clearance": 1.5}
        leader = find_leaders(history, who, paths, row, s, **far)
        pace = history.scene.now.speed[who.vehicle]

        def accelerate(step: int, v: Any, travelled: Any, along: Any) -> Any:
            gap = leader.gap + leader.speed * 0.1 * step - travelled
            follow = 0.25 * (gap - 2.0 - 1.8 * v) + 0.6 * (leader.speed - v)
            return np.clip(np.minimum(0.4 * (pace - v), follow), -3.5, 2.0)

        return drive(history, who, paths, row, accelerate)


FUNCTIONS: Mapping[str, Any] = {"cv": "constant_velocity", "acc": Acc(), "likely": "likely_driver"}


def run(population: Population, out: Path, limit_s: float) -> None:
    """Append what the functions do in each candidate that ``out`` does not have yet."""
    known = {one["k"] for one in read(out)} if out.exists() else set()
    began, loaded, recordings = time.process_time(), None, recordings_of(population)
    specs = {name: model_specs(given)[0] for name, given in FUNCTIONS.items()}
    order = sorted(range(len(population)), key=lambda k: (population.rows[k]["recording"], k))
    with out.open("a") as file:
        for k in order:
            if k in known or time.process_time() - began > limit_s:
                continue
            row = population.rows[k]
            if loaded is None or loaded.name != row["recording"]:
                loaded = cutter_of(recordings, row["recording"])
            file.write(json.dumps({"k": k, **of_candidate(loaded, row, specs)}) + "\n")
            file.flush()


def of_candidate(cutter: Any, row: Mapping[str, Any], specs: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the functions do in a candidate, or the error."""
    try:
        _, situation = cutter.situation(row)
        found: dict[str, Any] = {"people": situation.human_like, "most": situation.most}
        for name, spec in specs.items():
            began = time.process_time()
            record = record_of(situation, simulate(situation, spec, 64, seed=0))
            found[name] = {what: record[what] for what in KEPT} | {"s": time.process_time() - began}
    except scex.ScexError as error:
        return {"error": str(error)}
    return found


def read(file: Path) -> list[dict[str, Any]]:
    """Return the lines of a file."""
    return [json.loads(line) for line in file.read_text().splitlines()]


def judge(population: Population, lines: Sequence[Mapping[str, Any]], count: int, suites: int) -> None:
    """Print a line for each function."""
    lines = [one for one in lines if "error" not in one]
    kept = [population.rows[one["k"]] for one in lines]
    population = dataclasses.replace(population, rows=kept)
    people, most = (np.array([one[name] for one in lines]) for name in ("people", "most"))
    chosen = [choose(population, count, seed=seed) for seed in range(suites)]
    rng, size = np.random.default_rng(0), len(kept)
    plain = [rng.choice(size, count, replace=False) for _ in range(suites)]
    equal = np.full(count, size / count), np.zeros(count, dtype=np.int64), np.array([size])
    level = people.sum() / population.hours
    print(f"{size} candidates, {suites} suites of {count}; people {level:.3g} an hour")
    estimates = {}
    for name in FUNCTIONS:
        y = np.array([one[name]["probability"] for one in lines])
        drawn = np.array([one[name]["variance"] for one in lines])
        truth = y.sum() / population.hours

        def of(i: Any, weights: tuple[Any, Any, Any], y: Any = y, drawn: Any = drawn) -> tuple[float, ...]:
            found = rate(y[i], *weights, population.hours, most=most[i], drawn=drawn[i])
            return found.value, found.low, found.high

        own = np.array([of(c.index, (c.weight, c.stratum, c.sizes)) for c in chosen])
        other = np.array([of(i, equal) for i in plain])
        estimates[name] = own[:, 0]
        holds = np.mean((own[:, 1] <= truth) & (truth <= own[:, 2]))
        plainly = np.mean((other[:, 1] <= truth) & (truth <= other[:, 2]))
        wide = np.median(own[:, 2] - own[:, 1])
        width = wide / np.median(other[:, 2] - other[:, 1])
        error = np.sqrt(np.mean((own[:, 0] - truth) ** 2) / np.mean((other[:, 0] - truth) ** 2))
        equal_to_people = np.mean((own[:, 1] <= level) & (level <= own[:, 2]))
        largest = y.max() / max(y.sum(), 1e-300)
        print(
            f"{name}: {truth:.3g} an hour, largest candidate {largest:.0%}; mean/truth "
            f"{own[:, 0].mean() / truth:.2f}; holds {holds:.1%} (plain {plainly:.1%}), people's rate in "
            f"{equal_to_people:.1%}; width {wide / truth:.2f} of the rate, {width:.2f} of plain; "
            f"error {error:.2f} of plain"
        )
    right = np.mean((estimates["cv"] > estimates["acc"]) & (estimates["acc"] > estimates["likely"]))
    print(f"order as in full: {right:.0%}")


def main() -> None:
    """Run or judge, as the first argument says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=("run", "judge"))
    parser.add_argument("ranking", type=Path)
    parser.add_argument("file", type=Path)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--suites", type=int, default=200)
    parser.add_argument("--limit", type=float, default=float("inf"), help="s of processor time")
    given = parser.parse_args()
    population = read_population([given.ranking])
    if given.what == "run":
        run(population, given.file, given.limit)
    else:
        judge(population, read(given.file), given.count, given.suites)


if __name__ == "__main__":
    main()
