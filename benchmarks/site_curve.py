"""How well learned drivers do at a place never seen, over the number of sites that they were trained on.

    python benchmarks/site_curve.py OUT [--data FOLDER]... [--kinds graph hybrid joint] [--left-out SITE...]
                                        [--counts 2 4 6 8] [--seeds 3] [--steps 800] [--moments 800]
                                        [--trained FOLDER]

Each point is a training of its own with the same number of steps, without a round in closed loop; its epoch
is the best on validation parts of the sites that it learns from. A seed draws the order of the sites, of
which a training takes the first ones. Measured is the test part of the site left out: error of moving
vehicles after 3 s as a share of constant velocity's, and the share of vehicles that collide within these 3 s,
beside that recorded; with and without the guard. `--trained` measures networks that
`scex-sumo train --leave-out ...` made, FOLDER/KIND-SEED.safetensors; give --counts the number of their sites.
OUT keeps weights and `results.json`; only what is missing there is done, so other options need another OUT.
FOLDER of --data: as of predictors.py, with INTERACTION.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import predictors_measures as measures
import torch
from predictors import Results, data_root, learned, measure_errors, part_of

from scex_sumo.base.arrays import BoolArray
from scex_sumo.behaviors.base import PLAN_STEPS, BatchBehavior
from scex_sumo.behaviors.driving.paths import seed_paths
from scex_sumo.converters.datasets.find import find_recordings
from scex_sumo.converters.registries import Recording
from scex_sumo.drivers.registry import ModelSpec, build
from scex_sumo.evaluation.split import Split
from scex_sumo.humans.guard.guarded import Guarded
from scex_sumo.learned.training.closed_loop import REPLAN
from scex_sumo.learned.training.data.dataset import (
    Dataset,
    SampleOptions,
    loaded_sites,
    make_dataset,
    part_scenes,
)
from scex_sumo.learned.training.data.samples import TrainingSamples
from scex_sumo.learned.training.networks.graph_image import save_net
from scex_sumo.learned.training.train import Kind, Trainer, TrainOptions

SETS = ("mona", "taf_bw", "ngsim", "interaction")
LEFT_OUT = ("DR_USA_Roundabout_FT", "DR_USA_Intersection_EP0", "k733_2020-09-15")
TEST_MOMENTS = 250  # of a site; a fifth of them is measured
PER_GRAPH = {"node": "nodes", "history": "nodes", "pose": "nodes", "edge": "edges", "edge_index": "edges"}


def samples_of(recordings: Sequence[Recording], moments: int) -> Dataset:
    """Return the samples of all sites; recordings for tests are left out."""
    kept = [r for r in recordings if part_of(r.name) != "test"]
    short = tuple(r.name for r in kept if part_of(r.name) == "validation")
    options = SampleOptions(moments=moments, split=Split(kept_validation=short))
    return make_dataset(kept, options)


def of_sites(dataset: Dataset, names: Sequence[str]) -> Dataset:
    """Return the samples of some sites."""
    wanted = np.isin(dataset.sites, names)
    parts = {
        "train": chosen(dataset.train, wanted[dataset.train.site]),
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


def train(dataset: Dataset, kind: Kind, seed: int, steps: int, file: Path) -> None:
    """Train a network for about so many steps."""
    nodes = int(dataset.train.nodes.sum())
    epochs = max(1, round(steps * TrainOptions.nodes / nodes))
    run = Trainer(dataset, TrainOptions(kind=kind, seed=seed, epochs=epochs, rounds=0, patience=epochs))
    run.run(lambda progress: None)
    save_net(file, run.finished(), {"sites": sorted(set(np.array(dataset.sites)[dataset.train.site]))})


def test_scenes(recordings: Sequence[Recording], site: str) -> list[measures.TestScene]:
    """Return the scenes of a site's test part."""
    split = Split(kept_test=tuple(r.name for r in recordings if part_of(r.name) == "test"))
    ((_, here, every_s),) = loaded_sites([r for r in recordings if r.site == site], TEST_MOMENTS)
    return [
        measures.TestScene(site=site, scene=scene, road=loaded.road)
        for loaded in here
        for scene in part_scenes(loaded, "test", split=split, every_s=every_s)
    ]


def percent_that_collide(tests: Sequence[measures.TestScene], model: BatchBehavior, kind: str) -> list[float]:
    """Return % of vehicles that collide in futures, and in the recording."""
    hits, counts = np.zeros(2), np.zeros(2)
    for test in tests:
        # The plan of `joint` is what it drives in closed loop.
        replan = PLAN_STEPS if kind == "joint" else REPLAN
        futures, future = measures.drawn_futures(test, model, replan=replan), test.scene.future
        assert future is not None
        on_road = seed_paths(test.scene, test.road).on_road
        for k, states in enumerate([*futures.swapaxes(1, 2), future[:, :PLAN_STEPS]]):
            recorded = int(k == len(futures.x))
            hits[recorded] += measures.collided(test.scene, states, on_road).sum()
            counts[recorded] += on_road.sum()
    return (100 * hits / counts).tolist()


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
    lines += ["", _row("network, sites", "left out", "collide %"), _row(*["---"] * 3)]
    futures: dict[tuple[str, str], list[Any]] = {}
    for name, found in numbers.items():
        part, kind, site, *rest = name.split("|")
        if part == "futures":
            futures.setdefault((f"{kind}, {rest[0]}" if rest else kind, site), []).append(found)
    for (kind, site), found in sorted(futures.items()):
        hit, recorded = np.mean(found, axis=0)
        lines.append(_row(kind, site, f"{hit:.2f} (recorded {recorded:.2f})"))
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
    parser.add_argument("--moments", type=int, default=SampleOptions.moments)
    parser.add_argument("--trained", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    recordings = find_recordings(given.data or [data_root() / name for name in SETS])
    results = Results(given.out / "results.json")
    if given.trained is None:
        dataset = samples_of(recordings, given.moments)
        trained = np.array(dataset.sites)[np.unique(dataset.train.site)].tolist()
    scenes = {site: test_scenes(recordings, site) for site in given.left_out}

    def network(kind: str, site: str, count: int, seed: int, mode: str = "best") -> Any:
        if given.trained is not None:
            return learned(given.trained / f"{kind}-{seed}.safetensors", kind, mode=mode)
        file = given.out / f"{kind}-{count}-{site}-{seed}.safetensors"
        if not file.exists():
            order = np.random.default_rng(seed).permutation([other for other in trained if other != site])
            train(of_sites(dataset, order[:count].tolist()), kind, seed, given.steps, file)  # type: ignore[arg-type]
        return learned(file, kind, mode=mode)

    def futures(name: str, site: str, kind: str, make: Callable[[], BatchBehavior]) -> None:
        results.add(f"futures|{name}", lambda: percent_that_collide(scenes[site], make(), kind))

    for site in given.left_out:
        results.add(f"errors|straight_on|{site}", lambda: measure_errors(scenes[site], "straight_on"))  # noqa: B023
        futures(f"likely|{site}", site, "likely", lambda: build(ModelSpec(name="likely_driver")))
    for seed, kind, site, count in product(range(given.seeds), given.kinds, given.left_out, given.counts):
        key, rest = (kind, site, count, seed), f"{site}|{count}|{seed}"
        results.add(f"errors|{kind}|{rest}", lambda: measure_errors(scenes[site], network(*key)))  # noqa: B023
        if count in (min(given.counts), max(given.counts)):
            futures(f"{kind}|{rest}", site, kind, lambda: network(*key, "draw"))  # noqa: B023
            if kind != "joint":
                futures(f"{kind}+guard|{rest}", site, kind, lambda: Guarded(network(*key, "draw")))  # noqa: B023
    print(table(results.numbers))


if __name__ == "__main__":
    main()
