"""Truth of a suite's number: all candidates of a ranking in full, against suites of some of them.

    python benchmarks/suite_truth.py run RANKING full.jsonl
    python benchmarks/suite_truth.py judge RANKING full.jsonl

`run` drives people and three functions through every candidate with 64 futures, a line each; it goes on where
it was stopped. `judge` makes suites with other random seeds, and prints how often their intervals hold the
rate of all candidates, how wide they are, and their error against that of as many candidates drawn equally.
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

from scex_sumo.behaviors.driving.leaders import find_leaders
from scex_sumo.behaviors.driving.motion import drive as along
from scex_sumo.behaviors.driving.paths import chosen_paths, expected_way
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.drivers.registry import model_specs
from scex_sumo.suites.catalogue import Chosen, choose, seed_scene
from scex_sumo.suites.drive import drive
from scex_sumo.suites.estimate import Design, Rate
from scex_sumo.suites.population import Population, read_population

FUTURES = 64


class Acc:
    """Adaptive cruise control that sees leaders on its straightest path, and nothing that crosses it."""

    def plan(self, history: Any, road: Any, vehicles: Any, rng: Any) -> Any:
        """Keep the first speed, and 2 m with 1.8 s to the leader."""
        paths, row = chosen_paths(history, road, vehicles, "straight")
        own = history.now[vehicles.future, vehicles.vehicle]
        s, _, _ = paths.foot_points(row, own.x, own.y, expected_way(history, vehicles))
        leader = find_leaders(history, vehicles, paths, row, s, clearance=1.5, radius=100.0)
        pace = history.scene.now.speed[vehicles.vehicle]

        def accelerate(step: int, v: Any, travelled: Any, s: Any) -> Any:
            gap = leader.gap + leader.speed * 0.1 * step - travelled
            follow = 0.25 * (gap - 2.0 - 1.8 * v) + 0.6 * (leader.speed - v)
            return np.clip(np.minimum(0.4 * (pace - v), follow), -3.5, 2.0)

        return along(history, vehicles, paths, row, accelerate)


FUNCTIONS: Mapping[str, Any] = {
    "people": None,
    "idm": "calibrated_driver",
    "acc": Acc(),
    "blind": "constant_velocity",
}


def run(population: Population, out: Path, limit_s: float) -> None:
    """Append what the functions do in each candidate that ``out`` does not have yet."""
    known = {one["k"] for one in read(out)} if out.exists() else set()
    began = time.process_time()
    recordings = {one.name: one for one in find_recordings(list(population.roots))}
    specs = {name: given and model_specs(given)[0] for name, given in FUNCTIONS.items()}
    order = sorted(range(len(population)), key=lambda k: (population.rows[k]["recording"], k))
    with out.open("a") as file:
        for k in order:
            if k in known or time.process_time() - began > limit_s:
                continue
            row = population.rows[k]
            scene, found = seed_scene(recordings, row), {}
            for name, spec in specs.items():
                driven = drive(scene, row["track_id"], spec, FUTURES, seed=0)
                pair = driven.contacts_with(row["other_id"])
                found[name] = {
                    "y": pair.probability,
                    "variance": float(pair.effects.var(ddof=1) / FUTURES),
                    "any": driven.contacts.probability,
                    "collide": float(driven.collides.mean()),
                }
            file.write(json.dumps({"k": k, **found}) + "\n")
            file.flush()


def read(file: Path) -> list[dict[str, Any]]:
    """Return the lines of a file."""
    return [json.loads(line) for line in file.read_text().splitlines()]


def judge(population: Population, lines: Sequence[Mapping[str, Any]], count: int, suites: int) -> None:
    """Print a line for each function."""
    population = dataclasses.replace(population, rows=[population.rows[one["k"]] for one in lines])
    share, kind, size = population.column("share"), population.kind, len(population)
    chosen = [choose(population, count, seed=seed) for seed in range(suites)]
    rng = np.random.default_rng(0)
    equal = [(rng.choice(size, count, replace=False), np.full(count, count / size)) for _ in range(suites)]
    by_ranking = (share * population.column("probability")).sum() / population.hours
    print(f"{size} candidates, {suites} suites of {count}; people by the ranking {by_ranking:.3g} an hour")
    estimates = {}
    for name in FUNCTIONS:
        y, drawn, either = (np.array([one[name][key] for one in lines]) for key in ("y", "variance", "any"))
        truth = float((share * y).sum() / population.hours)

        def rates(some: Sequence[Chosen], *, strata: bool, y: Any = y, drawn: Any = drawn) -> list[Rate]:
            return [
                Design(
                    weight=share[index] / chance,
                    chance=chance,
                    stratum=kind[index] if strata else np.zeros(len(index), np.int64),
                    hours=population.hours,
                ).rate(y[index], drawn[index])
                for index, chance in some
            ]

        own, other = rates(chosen, strata=True), rates(equal, strata=False)
        held = [np.mean([r.low <= truth <= r.high for r in some]) for some in (own, other)]
        estimates[name], plain = (np.array([r.value for r in some]) for some in (own, other))
        factors = [r.high / max(r.low, 1e-300) for r in own]
        error = np.sqrt(np.mean((estimates[name] - truth) ** 2) / np.mean((plain - truth) ** 2))
        thirds, largest = (share * either).sum() / population.hours, (share * y).max() / (share * y).sum()
        print(
            f"{name}: {truth:.3g} an hour, with third ones {thirds:.3g}, largest candidate "
            f"{largest:.0%}; mean/truth {estimates[name].mean() / truth:.2f}; holds {held[0]:.1%} (plain "
            f"{held[1]:.1%}); median factor {np.median(factors):.3g}; error {error:.2f} of plain"
        )
    right = np.mean(estimates["blind"] > np.maximum(estimates["acc"], estimates["idm"]))
    print(f"blind above acc and idm: {right:.0%}")


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
