"""How well learned drivers do at a place never seen, over the number of sites that they were trained on.

    python benchmarks/site_curve.py OUT [--data FOLDER]... [--kinds graph hybrid joint] [--left-out SITE...]
                                        [--counts 2 4 6 8] [--seeds 3] [--steps 800] [--minutes M]
                                        [--moments 800] [--stops 3] [--device auto|cpu|cuda]
                                        [--hidden 64] [--share 1] [--prior 0.5] [--together]
                                        [--trained FOLDER]

Each point is a training of its own with the same number of steps, without a round in closed loop; its epoch
is the best on validation parts of the sites that it learns from. A seed draws the order of the sites, of
which a training takes the first ones. Measured is the test part of the site left out: error of moving
vehicles after 3 s as a share of constant velocity's, and for the fewest and the most sites minJointFDE of six
futures of a scene (*apart*: if each vehicle has them in an order of its own), and the shares of vehicles that
collide or leave the road within these 3 s, beside those recorded; with and without the guard. `--hidden`
is the width of the networks, `--share` that of the moments that are trained on, `--stops` the number of
copies of each with standing vehicles, `--prior` a parameter of `joint_predictor`. `--together` leaves all
these sites out of each training. `--trained` measures networks that `scex-sumo train --leave-out ...` made,
FOLDER/KIND-SEED.safetensors; give --counts the number of their sites. OUT keeps samples, weights and
`results.json`; only what is missing there is done, so other options need another OUT. FOLDER of --data: as of
predictors.py, with INTERACTION.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import predictors_measures as measures
import torch
from predictors import Results, data_root, learned, measure_errors, part_of

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.drivers.registry import ModelSpec, build
from scex_sumo.evaluation.recordings import load_recording
from scex_sumo.evaluation.split import Split
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.learned.profiles import JointPredictorProfile
from scex_sumo.learned.training.data.dataset import (
    Dataset,
    SampleOptions,
    make_dataset,
    moments_apart,
    part_scenes,
)
from scex_sumo.learned.training.data.samples import TrainingSamples, learnable
from scex_sumo.learned.training.networks.graph_image import save_net
from scex_sumo.learned.training.train import Kind, Trainer, TrainOptions
from scex_sumo.scene import States

SETS = ("mona", "taf_bw", "ngsim", "interaction")
LEFT_OUT = ("DR_USA_Roundabout_FT", "DR_USA_Intersection_EP0", "k733_2020-09-15")
TEST_MOMENTS = 250  # of a site; a fifth of them is measured
PER_GRAPH = {"node": "nodes", "history": "nodes", "pose": "nodes", "edge": "edges", "edge_index": "edges"}


def samples_of(recordings: Sequence[Recording], moments: int, stops: int) -> Dataset:
    """Return the samples of all sites; recordings for tests are left out."""
    kept = [r for r in recordings if part_of(r.name) != "test"]
    short = tuple(r.name for r in kept if part_of(r.name) == "validation")
    options = SampleOptions(moments=moments, stops=stops, split=Split(kept_validation=short))
    return make_dataset(kept, options)


def of_sites(dataset: Dataset, names: Sequence[str], share: float = 1.0) -> Dataset:
    """Return the samples of some sites; of those to train on a share."""
    wanted = np.isin(dataset.sites, names)
    kept = np.random.default_rng(0).random(len(dataset.train)) < share
    parts = {
        "train": chosen(dataset.train, wanted[dataset.train.site] & kept),
        "validation": chosen(dataset.validation, wanted[dataset.validation.site]),
    }
    return dataclasses.replace(dataset, recorded=len(parts["train"]), **parts)


def chosen(samples: TrainingSamples, graph: BoolArray) -> TrainingSamples:
    """Return some graphs (G,)."""
    keep = {name: np.repeat(graph, getattr(samples, name)) for name in ("nodes", "edges", "pairs")}
    keep |= {name: keep[counted] for name, counted in PER_GRAPH.items()}
    columns = {}
    for field in dataclasses.fields(TrainingSamples):
        values = getattr(samples, field.name)
        rows = graph if len(values) == len(graph) else keep.get(field.name, keep["pairs"])
        columns[field.name] = values[:, rows] if field.name == "edge_index" else values[rows]
    return TrainingSamples(**columns)


def train(
    dataset: Dataset, kind: Kind, seed: int, steps: int, file: Path, device: str = "cpu", hidden: int = 64
) -> None:
    """Train a network for about so many steps."""
    nodes = int(dataset.train.nodes.sum())
    epochs = max(1, round(steps * TrainOptions.nodes / nodes))
    sizes = {"hidden": hidden}
    options = TrainOptions(kind=kind, seed=seed, epochs=epochs, rounds=0, patience=epochs, sizes=sizes)
    run = Trainer(dataset, options, device=torch.device(device))
    run.run(lambda progress: None)
    save_net(file, run.finished(), {"sites": sorted(set(np.array(dataset.sites)[dataset.train.site]))})


def test_scenes(recordings: Sequence[Recording], site: str) -> list[measures.TestScene]:
    """Return the scenes of a site's test part."""
    here = [load_recording(recording) for recording in recordings if recording.site == site]
    split = Split(kept_test=tuple(r.name for r in recordings if part_of(r.name) == "test"))
    every_s = moments_apart(here, TEST_MOMENTS)
    return [
        measures.TestScene(site=site, scene=scene, road=loaded.road)
        for loaded in here
        for scene in part_scenes(loaded, "test", split=split, every_s=every_s)
    ]


def measure_futures(tests: Sequence[measures.TestScene], model: BatchBehavior, kind: str) -> dict[str, Any]:
    """Return means over scenes: minJointFDE of six, and % of vehicles that collide, and leave the road.

    Those of the recording come last. `apart_fde_m`: minJointFDE if each vehicle has its own order of the six.
    """
    rows, apart, counts = [], [], np.zeros((2, 3))
    for test in tests:
        # The plan of `joint` is what it drives in closed loop.
        futures = measures.drawn_futures(
            test, model, replan=PLAN_STEPS if kind == "joint" else measures.REPLAN
        )
        vehicle = learnable(test.scene)
        rows.append(measures.joint_figures(test, futures, vehicle)[1])
        apart.append(measures.joint_figures(test, shuffled(futures), vehicle)[1])
        future = test.scene.future
        assert future is not None
        recorded = measures.judged(test, test.scene, future[:, :PLAN_STEPS])
        counts[1] += _counts(recorded)
        for one in range(2 * measures.GUESSES):
            counts[0] += _counts(measures.judged(test, test.scene, futures[one].swapaxes(0, 1)))
    share = 100 * counts[:, 1:] / counts[:, :1]
    return {
        "min_joint_fde_m": float(np.mean(rows)),
        "apart_fde_m": float(np.mean(apart)),
        "percent": share.ravel().tolist(),
    }


def drawing(file: Path, kind: str, guard: str, prior: float = JointPredictorProfile.prior) -> BatchBehavior:
    """Return a network's driver that draws, with the guard unless `guard` is empty."""
    model: BatchBehavior = learned(file, kind, mode="draw", prior=prior)
    return Guarded(model) if guard else model


def shuffled(futures: States) -> States:
    """Return futures (C, H, V) in which each vehicle has an order of its own within groups of six."""
    rng, (count, _, vehicles) = np.random.default_rng(0), futures.shape
    of_six = rng.permuted(
        np.tile(np.arange(measures.GUESSES), (count // measures.GUESSES, vehicles, 1)), axis=2
    )
    order = of_six + measures.GUESSES * np.arange(len(of_six))[:, None, None]
    row = order.swapaxes(1, 2).reshape(count, 1, vehicles)
    return futures.map(lambda values: np.take_along_axis(values, row, axis=0))


def _counts(loop: measures.Loop) -> FloatArray:
    return np.array([loop.driven.sum(), (loop.collided & loop.driven).sum(), (loop.left & loop.driven).sum()])


def error_share(numbers: Mapping[str, Any], name: str) -> float:
    """Return the error of moving vehicles after 3 s as a share of constant velocity's."""
    site = name.split("|")[2]
    sums = (numbers[name], numbers[f"errors|straight_on|{site}"])
    mine, straight = (next(v[2] for key, v in s.items() if key.endswith("|moving")) for s in sums)
    return float(mine / straight)


def table(numbers: Mapping[str, Any]) -> str:
    """Return the results so far as Markdown."""
    shares: dict[tuple[str, int], dict[str, list[float]]] = {}
    for name in numbers:
        part, kind, site, *rest = name.split("|")
        if part == "errors" and rest:
            row = shares.setdefault((kind, int(rest[0])), {})
            row.setdefault(site, []).append(error_share(numbers, name))
    sites = sorted({site for row in shares.values() for site in row})
    lines = [_row("network", "sites", *sites, "mean"), _row(*["---"] * (len(sites) + 3))]
    for (kind, count), row in sorted(shares.items()):
        cells = [_spread(row[site]) if site in row else "" for site in sites]
        lines.append(_row(kind, str(count), *cells, f"{np.mean([np.mean(v) for v in row.values()]):.2f}"))
    lines += [
        "",
        _row("network, sites", "left out", "minJointFDE m", "apart m", "collide %", "leave the road %"),
    ]
    lines += [_row(*["---"] * 6)]
    futures: dict[tuple[str, str], list[Any]] = {}
    for name, found in numbers.items():
        part, kind, site, *rest = name.split("|")
        if part == "futures":
            futures.setdefault((f"{kind}, {rest[0]}" if rest else kind, site), []).append(found)
    for (kind, site), found in sorted(futures.items()):
        fde, apart = (_spread([one[key] for one in found]) for key in ("min_joint_fde_m", "apart_fde_m"))
        hit, left, hit_recorded, left_recorded = np.mean([one["percent"] for one in found], axis=0)
        beside = (f"{hit:.2f} (recorded {hit_recorded:.2f})", f"{left:.1f} (recorded {left_recorded:.1f})")
        lines.append(_row(kind, site, fde, apart, *beside))
    return "\n".join(lines)


def _spread(values: Sequence[float]) -> str:
    return f"{np.mean(values):.2f} ({min(values):.2f}–{max(values):.2f})"


def _row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, action="append", default=[])
    parser.add_argument("--kinds", nargs="+", default=["graph", "joint"])
    parser.add_argument("--left-out", nargs="+", default=list(LEFT_OUT))
    parser.add_argument("--counts", nargs="+", type=int, default=[2, 4, 6, 8])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=800)
    parser.add_argument("--minutes", type=float, default=np.inf, help="begin nothing later than this")
    parser.add_argument("--moments", type=int, default=SampleOptions.moments)
    parser.add_argument("--stops", type=int, default=SampleOptions.stops)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--hidden", type=int, default=64)
    parser.add_argument("--share", type=float, default=1.0)
    parser.add_argument("--prior", type=float, default=JointPredictorProfile.prior)
    parser.add_argument("--together", action="store_true")
    parser.add_argument("--trained", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    begun = time.monotonic()
    recordings = find_recordings(given.data or [data_root() / name for name in SETS])
    results = Results(given.out / "results.json")
    if given.trained is None:
        dataset = samples_of(recordings, given.moments, given.stops)
        trained = np.array(dataset.sites)[np.unique(dataset.train.site)].tolist()
    scenes = {site: test_scenes(recordings, site) for site in given.left_out}

    def add(name: str, measure: Callable[[], Any]) -> None:
        if time.monotonic() - begun < 60 * given.minutes:
            results.add(name, measure)

    def file_of(kind: str, site: str, count: int, seed: int) -> Path:
        if given.trained is not None:
            return Path(given.trained / f"{kind}-{seed}.safetensors")
        return given.out / f"{kind}-{count}-{'all' if given.together else site}-{seed}.safetensors"

    def network(kind: str, site: str, count: int, seed: int) -> Any:
        file = file_of(kind, site, count, seed)
        if given.trained is None and not file.exists():
            left_out = given.left_out if given.together else [site]
            order = np.random.default_rng(seed).permutation([x for x in trained if x not in left_out])
            some = of_sites(dataset, order[:count].tolist(), given.share)
            train(some, kind, seed, given.steps, file, given.device, given.hidden)  # type: ignore[arg-type]
        return learned(file, kind, prior=given.prior)

    for site in given.left_out:
        add(f"errors|straight_on|{site}", lambda: measure_errors(scenes[site], "straight_on"))  # noqa: B023
        likely = build(ModelSpec(name="likely_driver"))
        add(f"futures|likely|{site}", lambda: measure_futures(scenes[site], likely, "likely"))  # noqa: B023
    for seed in range(given.seeds):
        for kind in given.kinds:
            for site in given.left_out:
                for count in given.counts:
                    name = f"{kind}|{site}|{count}|{seed}"
                    add(
                        f"errors|{name}",
                        lambda: measure_errors(scenes[site], network(kind, site, count, seed)),  # noqa: B023
                    )
                    if count not in (min(given.counts), max(given.counts)):
                        continue
                    file = file_of(kind, site, count, seed)
                    for guard in ("",) if kind == "joint" else ("", "+guard"):
                        add(
                            f"futures|{kind}{guard}|{site}|{count}|{seed}",
                            lambda: measure_futures(
                                scenes[site],  # noqa: B023
                                drawing(file, kind, guard, given.prior),  # noqa: B023
                                kind,  # noqa: B023
                            ),
                        )
    print(table(results.numbers))


if __name__ == "__main__":
    main()
