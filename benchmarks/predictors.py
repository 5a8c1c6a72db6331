"""How well learned drivers predict and drive, against rule-based ones and what they were to reach.

    python benchmarks/predictors.py OUT --data FOLDER... train    trains all networks that OUT does not have
    python benchmarks/predictors.py OUT --data FOLDER... errors   3 s of prediction on the test part
    python benchmarks/predictors.py OUT --data FOLDER... loop     10 s of closed loop from perturbed starts
    python benchmarks/predictors.py OUT --data FOLDER... joint    six futures of whole scenes
    python benchmarks/predictors.py OUT crossings                 joint's collisions on the example maps
    python benchmarks/predictors.py OUT table                     the results so far as Markdown

Everything is kept in OUT, and only what is missing there is done: weights as ``NAME.safetensors``, numbers in
``results.json``. ``--only WORD`` restricts a part to names with that word; ``--seeds`` says how many
trainings the means are over; ``--simulated MAP``, repeatable: joint trains on traffic simulated there, too.
FOLDER is searched for recordings; without it those of SCEX_DATA, else ../shared/data.

Test part: the last fifth of each recording, at least 1 s after what validation may use; of NGSIM, whose
recordings are too short to be cut, the files of `recorded_scenes.NGSIM_TEST`. Nothing of Peachtree is trained
on. Vehicles with 1 s of recorded past and 3 s of recorded future, those that move and those that stand apart.
Errors are those of the plan that the model drives, means over vehicles. Closed loop: all vehicles of a scene,
put off by up to 0.7 m and 5 degrees, driven by the model for 10 s; with the guard also from where they were.
Joint: all vehicles driven by the model for 3 s, in closed loop and, for `-once`, with the first plan.
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
from scex_sumo.learned.training.command import train_command
from scex_sumo.learned.training.data.samples import learnable
from scex_sumo.scene import SeedScene

# s between two moments: MONA has many vehicles, INTERACTION hours.
ERRORS_EVERY_S = {"MONA": 2.0, "INTERACTION": 10.0}
ERRORS_OFTEN_S = 0.5
LOOP_EVERY_S = {"TAF-BW": 1.0, "INTERACTION": 60.0}
LOOP_OFTEN_S = 4.0
YARDSTICKS: dict[str, Callable[[SeedScene, IntArray], FloatArray]] = {
    "straight_on": measures.straight_on,
    "stands_still": partial(measures.straight_on, stands=True),
    "next_second_known": partial(measures.foreseen, kept=1.0),
    "next_second_known_half": partial(measures.foreseen, kept=0.5),
}
RULES = ("calibrated_driver",)
KINDS = ("graph", "hybrid", "joint")
JOINT_EVERY_S = {"MONA": 4.0, "Peachtree": 0.5, "INTERACTION": 30.0}
JOINT_OFTEN_S = 1.0
EXAMPLES = ("roundabout", "urban_intersection", "motorway_merge")
ALONE = ("likely_driver", "constant_velocity")  # drawn independently, like `graph`


@dataclass(frozen=True, kw_only=True)
class Training:
    """One network to train."""

    name: str
    kind: str
    seed: int
    leave_out: str = ""


def trainings(sites: Sequence[str], seeds: int) -> Iterator[Training]:
    """All networks of the tables: seeds, and each site left out."""
    for kind in KINDS:
        for seed in range(seeds):
            yield Training(name=f"{kind}-{seed}", kind=kind, seed=seed)
    for seed in range(seeds):
        for site in sites:
            for kind in KINDS:
                name = f"{kind}-without-{site}-{seed}"
                yield Training(name=name, kind=kind, seed=seed, leave_out=site)


def train(
    out: Path,
    roots: Sequence[Path],
    names: Sequence[str],
    wanted: Sequence[Training],
    maps: Sequence[Path] = (),
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
            leave_out=[*apart["test"], *([training.leave_out] if training.leave_out else [])],
            simulated=list(maps) if training.kind == "joint" else [],
            validation=apart["validation"],
            resume=True,
        )
        print(f"{training.name}: {time.process_time() - begun:.0f} s of processor time", flush=True)


def learned(
    file: Path,
    kind: str,
    *,
    attention: float = 0.5,
    head: str = "bounded",
    mode: str = "best",
    prior: float = JointPredictorProfile.prior,
) -> Any:
    """A learned driver with a file of weights."""
    if kind == "joint":
        return learned_driver(kind, JointPredictorProfile(weights=str(file), mode=mode, prior=prior))
    if kind == "graph":
        return learned_driver(kind, GraphPredictorProfile(path="likeliest", weights=str(file), mode=mode))
    return learned_driver(
        kind, GraphImagePredictorProfile(weights=str(file), attention=attention, head=head, mode=mode)
    )


def variants(out: Path, wanted: Sequence[Training]) -> Iterator[tuple[str, str, Callable[[], Any]]]:
    """(name, site or "", constructor) of every driver that is measured."""
    for name in RULES:
        yield name, "", lambda name=name: build(ModelSpec(name=name))  # type: ignore[misc]
    for training in wanted:
        file = out / f"{training.name}.safetensors"
        if not file.exists():
            continue
        given: list[tuple[str, dict[str, Any]]] = [("", {})]
        if training.kind == "hybrid" and not training.leave_out:
            given += [("-w0", {"attention": 0.0}), ("-w1", {"attention": 1.0}), ("-free", {"head": "free"})]
        for suffix, options in given:

            def make(file: Path = file, kind: str = training.kind, options: dict[str, Any] = options) -> Any:
                return learned(file, kind, **options)

            name = training.name.rpartition("-")
            yield f"{name[0]}{suffix}-{name[2]}", training.leave_out, make


def measure_errors(scenes: Sequence[measures.TestScene], model: BatchBehavior | str) -> dict[str, Any]:
    """Sums of errors and counts by site, of vehicles that stand, move, and move and change their speed."""
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
        changes = moves & measures.changing(test.scene, vehicle)
        for group, chosen in (("standing", ~moves), ("moving", moves), ("changing", changes)):
            entry = sums.setdefault(f"{place(test.site)}|{test.site}|{group}", [0, 0.0, 0.0, 0.0])
            entry[0] += int(chosen.sum())
            entry[1] += float(off[chosen].mean(1).sum())
            entry[2] += float(off[chosen, -1].sum())
            entry[3] += float("nan") if best is None else float(best[chosen].sum())
    return sums


def measure_joint(scenes: Sequence[measures.TestScene], model: BatchBehavior, replan: int) -> dict[str, Any]:
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


def joint_variants(out: Path, seeds: int, sites: Sequence[str]) -> Iterator[tuple[str, str, Any, int]]:
    """(name, site or "", model, steps of a plan that are driven) of all that `measure_joint` measures."""
    for name in ALONE:
        yield name, "", build(ModelSpec(name=name)), measures.REPLAN
    for training in trainings(sites, seeds):
        file = out / f"{training.name}.safetensors"
        if training.kind == "hybrid" or not file.exists():
            continue
        model = learned(file, training.kind, mode="draw")
        # The plan of `joint` is what it drives in closed loop, so that one is enough.
        once = PLAN_STEPS if training.kind == "joint" else measures.REPLAN
        yield training.name, training.leave_out, model, once
        if training.kind == "graph":
            base, _, seed = training.name.rpartition("-")
            yield f"{base}-once-{seed}", training.leave_out, model, PLAN_STEPS


def measure_loop(
    scenes: Sequence[measures.TestScene], model: BatchBehavior | None, *, perturbs: bool = True
) -> dict[str, Any]:
    """Counts by site: vehicles driven, that left the road, that collided, that braked or accelerated hard.

    Args:
        model: None for what was recorded.
        perturbs: starts are perturbed ones.
    """
    sums: dict[str, Any] = {}
    for test in scenes:
        if model is None:
            found = measures.recorded_motion(test, perturbs=perturbs)
        else:
            found = measures.closed_loop(test, model, perturbs=perturbs)
        entry = sums.setdefault(f"{place(test.site)}|{test.site}", [0, 0, 0, 0])
        for k, flags in enumerate((found.driven, found.left, found.collided, found.hard)):
            entry[k] += int((flags & found.driven).sum())
    return sums


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


def _of_site(scenes: Sequence[measures.TestScene], site: str) -> list[measures.TestScene]:
    return [test for test in scenes if not site or test.site == site]


def data_root() -> Path:
    """The folder with the sets of recordings."""
    return Path(os.environ.get("SCEX_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def _recordings(given: Sequence[Path]) -> tuple[tuple[Recording, ...], tuple[Path, ...]]:
    roots = tuple(given) or tuple(data_root() / name for name in ("mona", "taf_bw", "ngsim", "interaction"))
    return find_recordings(roots), roots


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("part", choices=("train", "errors", "loop", "joint", "crossings", "table"))
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
    if given.part == "crossings":
        for file in sorted(given.out.glob("joint-*.safetensors")):
            model = learned(file, "joint", mode="draw")
            found = {name: measures.example_collisions(name, model) for name in EXAMPLES}
            print(f"{file.stem}: futures with a collision, of all: {found}", flush=True)
        return
    recordings, roots = _recordings(given.data)
    sites = sorted({r.site for r in recordings if part_of(r.name) != "test" and place(r.site) != "Peachtree"})
    names = [recording.name for recording in recordings]
    wanted = [t for t in trainings(sites, given.seeds) if given.only in t.name]
    if given.part == "train":
        train(given.out, roots, names, wanted, given.simulated)
        return
    looped = given.part == "loop"
    every, often = {
        "loop": (LOOP_EVERY_S, LOOP_OFTEN_S),
        "errors": (ERRORS_EVERY_S, ERRORS_OFTEN_S),
        "joint": (JOINT_EVERY_S, JOINT_OFTEN_S),
    }[given.part]
    scenes = [
        scene
        for recording in recordings
        for scene in measures.test_scenes(recording, every.get(place(recording.site), often))
    ]
    if given.part == "joint":
        for name, site, model, replan in joint_variants(given.out, given.seeds, sites):
            if given.only in name:
                some = _of_site(scenes, site)
                results.add(f"joint|{name}", lambda: measure_joint(some, model, replan))  # noqa: B023
        return
    if looped:
        results.add("loop|recorded", lambda: measure_loop(scenes, None))
        results.add("calm|recorded", lambda: measure_loop(scenes, None, perturbs=False))
    else:
        for name in YARDSTICKS:
            results.add(f"errors|{name}", lambda: measure_errors(scenes, name))  # noqa: B023
    for name, site, make in variants(given.out, trainings(sites, given.seeds)):
        if given.only not in name:
            continue
        some = _of_site(scenes, site)
        if not looped:
            results.add(f"errors|{name}", lambda: measure_errors(some, make()))  # noqa: B023
        elif not site:
            results.add(f"loop|{name}", lambda: measure_loop(some, make()))  # noqa: B023
            for part, perturbs in (("loop", True), ("calm", False)):
                results.add(
                    f"{part}|{name}+guard",
                    lambda: measure_loop(some, Guarded(make()), perturbs=perturbs),  # noqa: B023
                )


if __name__ == "__main__":
    main()
