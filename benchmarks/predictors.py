"""How well learned drivers predict and drive, against rule-based ones and what they were to reach.

    python benchmarks/predictors.py OUT --data FOLDER... train    trains all networks that OUT does not have
    python benchmarks/predictors.py OUT --data FOLDER... errors   3 s of prediction on the test part
    python benchmarks/predictors.py OUT --data FOLDER... joint    six futures of whole scenes
    python benchmarks/predictors.py OUT table                     the results so far as Markdown

Everything is kept in OUT, and only what is missing there is done: weights as ``NAME.safetensors``, numbers in
``results.json``. ``--only WORD`` restricts a part to names with that word; ``--seeds`` says how many
trainings the means are over; ``--simulated MAP``, repeatable: joint trains on traffic simulated there, too.
FOLDER is searched for recordings; without it those of SCEX_DATA, else ../shared/data.

Test part: the last fifth of each recording, at least 1 s after what validation may use; of NGSIM, whose
recordings are too short to be cut, the files of `recorded_scenes.NGSIM_TEST`. Nothing of Peachtree is trained
on. Vehicles with 1 s of recorded past and 3 s of recorded future, those that move and those that stand apart.
Errors are those of the plan that the model drives, means over vehicles. Joint: all vehicles driven by the
model for 3 s in closed loop.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import predictors_measures as measures
from predictors_report import place, tables
from recorded_scenes import ngsim_part

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.drivers.registry import ModelSpec, build
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.learned.driver import LearnedDriver
from scex_sumo.learned.models import learned as learned_driver
from scex_sumo.learned.profiles import (
    GraphImagePredictorProfile,
    GraphPredictorProfile,
    JointPredictorProfile,
)
from scex_sumo.learned.training.closed_loop import REPLAN
from scex_sumo.learned.training.command import train_command
from scex_sumo.learned.training.data.samples import learnable
from scex_sumo.scene import SeedScene

# s between two moments: MONA has many vehicles, INTERACTION hours.
ERRORS_EVERY_S = {"MONA": 2.0, "INTERACTION": 10.0}
ERRORS_OFTEN_S = 0.5
YARDSTICKS: dict[str, Callable[[SeedScene, IntArray], FloatArray]] = {
    "straight_on": measures.straight_on,
    "stands_still": partial(measures.straight_on, stands=True),
}
RULES = ("calibrated_driver",)
KINDS = ("graph", "hybrid", "joint")
JOINT_EVERY_S = {"MONA": 4.0, "Peachtree": 0.5, "INTERACTION": 30.0}
JOINT_OFTEN_S = 1.0
ALONE = ("likely_driver", "constant_velocity")  # drawn independently, like `graph`


@dataclass(frozen=True, kw_only=True)
class Training:
    """One network to train."""

    name: str
    kind: str
    seed: int


def trainings(seeds: int) -> list[Training]:
    """All networks of the tables."""
    return [Training(name=f"{k}-{seed}", kind=k, seed=seed) for k in KINDS for seed in range(seeds)]


def train(
    out: Path, roots: Sequence[Path], names: Sequence[str], wanted: Sequence[Training], maps: Sequence[Path]
) -> None:
    """Train what is not there yet; `names` are those of the recordings, `maps` those of simulated traffic."""
    apart = {part: [name for name in names if part_of(name) == part] for part in ("validation", "test")}
    for training in wanted:
        file = out / f"{training.name}.safetensors"
        if file.exists():
            continue
        begun = time.process_time()
        train_command(
            training.kind,
            data=list(roots),
            out=file,
            seed=training.seed,
            leave_out=apart["test"],
            simulated=list(maps) if training.kind == "joint" else [],
            validation=apart["validation"],
        )
        print(f"{training.name}: {time.process_time() - begun:.0f} s of processor time", flush=True)


def learned(file: Path, kind: str, *, mode: str = "best") -> Any:
    """A learned driver with a file of weights."""
    profile = {"graph": GraphPredictorProfile, "hybrid": GraphImagePredictorProfile}.get(
        kind, JointPredictorProfile
    )
    return learned_driver(kind, profile(path="likeliest", weights=str(file), mode=mode))


def measure_errors(scenes: Sequence[measures.TestScene], model: BatchBehavior | str) -> dict[str, Any]:
    """Sums of errors and counts by site, of vehicles that stand and that move."""
    sums: dict[str, Any] = {}
    for test in scenes:
        vehicle = learnable(test.scene)
        if isinstance(model, str):
            off = YARDSTICKS[model](test.scene, vehicle)
        else:
            off = measures.planned(test, model, vehicle)
        modes = isinstance(model, LearnedDriver) and not model.free and model.kind != "joint"
        best = measures.best_of_six(test, model, vehicle) if modes else None
        moves = measures.moving(test.scene, vehicle)
        for group, chosen in (("standing", ~moves), ("moving", moves)):
            entry = sums.setdefault(f"{place(test.site)}|{test.site}|{group}", [0, 0.0, 0.0, 0.0])
            entry[0] += int(chosen.sum())
            entry[1] += float(off[chosen].mean(1).sum())
            entry[2] += float(off[chosen, -1].sum())
            entry[3] += float("nan") if best is None else float(best[chosen].sum())
    return sums


def measure_joint(scenes: Sequence[measures.TestScene], model: Any, replan: int) -> dict[str, Any]:
    """Sums by site: scenes, figures `measures.JOINT`, moving vehicles, their errors, `straight_on`'s."""
    sums: dict[str, Any] = {}
    for test in scenes:
        vehicle = learnable(test.scene)
        futures = measures.drawn_futures(test, model, replan=replan)
        moves = measures.moving(test.scene, vehicle)
        off = measures.final_errors(test, futures, vehicle)[:, moves].mean(0)
        straight = measures.straight_on(test.scene, vehicle)[moves, -1]
        row = [1, *measures.joint_figures(test, futures, vehicle), moves.sum(), off.sum(), straight.sum()]
        entry = sums.setdefault(f"{place(test.site)}|{test.site}", [0.0] * len(row))
        entry[:] = [float(old + new) for old, new in zip(entry, row, strict=True)]
    return sums


def joint_variants(out: Path, seeds: int) -> Iterator[tuple[str, Any, int]]:
    """(name, model, steps of a plan that are driven) of all that `measure_joint` measures."""
    for name in ALONE:
        yield name, build(ModelSpec(name=name)), REPLAN
    for training in trainings(seeds):
        file = out / f"{training.name}.safetensors"
        if training.kind == "hybrid" or not file.exists():
            continue
        model = learned(file, training.kind, mode="draw")
        # The plan of `joint` is what it drives in closed loop, so that one is enough.
        yield training.name, model, PLAN_STEPS if training.kind == "joint" else REPLAN
        if training.kind == "graph":
            yield f"{training.name}+guard", Guarded(model), REPLAN


class Results:
    """Numbers in a file, written after each new one."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.numbers: dict[str, Any] = json.loads(file.read_text()) if file.exists() else {}

    def add(self, key: str, make: Callable[[], Any]) -> None:
        """Measure unless it is there already."""
        if key in self.numbers:
            return
        begun = time.process_time()
        found = make()
        # Another part may have written meanwhile.
        self.numbers = json.loads(self.file.read_text()) if self.file.exists() else {}
        self.numbers[key] = found
        self.file.write_text(json.dumps(self.numbers, indent=1))
        print(f"{key}: {time.process_time() - begun:.0f} s", flush=True)


def part_of(name: str) -> str | None:
    """The part that a recording of NGSIM is in as a whole; None for others.

    Nothing of Peachtree is trained on: what is not for tests there shows while training how a new place goes.
    """
    if place(name) not in ("Lankershim", "Peachtree"):
        return None
    part = ngsim_part(name)
    return "validation" if part == "train" and place(name) == "Peachtree" else part


def data_root() -> Path:
    """The folder with the sets of recordings."""
    return Path(os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def _recordings(given: Sequence[Path]) -> tuple[tuple[Recording, ...], tuple[Path, ...]]:
    roots = tuple(given) or tuple(data_root() / name for name in ("mona", "taf_bw", "ngsim", "interaction"))
    return find_recordings(roots), roots


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("part", choices=("train", "errors", "joint", "table"))
    parser.add_argument("--data", type=Path, action="append", default=[])
    parser.add_argument("--simulated", type=Path, action="append", default=[])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    results = Results(given.out / "results.json")
    if given.part == "table":
        print(tables(results.numbers))
        return
    recordings, roots = _recordings(given.data)
    if given.part == "train":
        wanted = [training for training in trainings(given.seeds) if given.only in training.name]
        train(given.out, roots, [recording.name for recording in recordings], wanted, given.simulated)
        return
    joint = given.part == "joint"
    every, often = (JOINT_EVERY_S, JOINT_OFTEN_S) if joint else (ERRORS_EVERY_S, ERRORS_OFTEN_S)
    scenes = [
        scene
        for recording in recordings
        for scene in measures.test_scenes(recording, every.get(place(recording.site), often))
    ]
    if joint:
        for name, model, replan in joint_variants(given.out, given.seeds):
            if given.only in name:
                results.add(f"joint|{name}", lambda: measure_joint(scenes, model, replan))  # noqa: B023
        return
    for name in YARDSTICKS:
        results.add(f"errors|{name}", lambda: measure_errors(scenes, name))  # noqa: B023
    models = {name: build(ModelSpec(name=name)) for name in RULES}
    for training in trainings(given.seeds):
        if (file := given.out / f"{training.name}.safetensors").exists():
            models[training.name] = learned(file, training.kind)
    for name, model in models.items():
        if given.only in name:
            results.add(f"errors|{name}", lambda: measure_errors(scenes, model))  # noqa: B023


if __name__ == "__main__":
    main()
