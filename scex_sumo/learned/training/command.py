"""``scex-sumo train``: train a learned driver on recordings."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from scex_sumo.base.errors import MissingExtraError, ResultError, UsageError
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.options import Seed

if TYPE_CHECKING:
    from scex_sumo.converters.registries import Recording
    from scex_sumo.evaluation.split import Split
    from scex_sumo.learned.training.train import Progress, Trainer

NETWORKS = ("graph", "hybrid", "joint")
SCENES = "scenes"
MOMENTS = 800
EXAMPLE = "graph --data scex_sumo/scenarios/data --validation roundabout --epochs 1 -o out/mine.safetensors"


def train_command(
    kind: Annotated[
        str,
        Argument(
            metavar="graph|hybrid|joint|scenes",
            help="Network, or scene model of 'generate'.",
            show_default=False,
        ),
    ],
    data: Annotated[
        list[Path] | None, Option(metavar="ROOT", help="Folder with recordings; repeatable.")
    ] = None,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="WEIGHTS", help="File of weights to write.")
    ] = None,
    simulated: Annotated[
        list[Path] | None,
        Option(metavar="MAP", help="Train on traffic that SUMO simulates on this map, too; repeatable."),
    ] = None,
    seed: Seed = 0,
    epochs: Annotated[int | None, Option(help="Passes over all samples; default: as shipped.")] = None,
    leave_out: Annotated[
        list[str] | None, Option(metavar="NAME", help="Do not train on this site or recording; repeatable.")
    ] = None,
    validation: Annotated[
        list[str] | None,
        Option(metavar="NAME", help="Validate on this short recording (under 20 s); repeatable."),
    ] = None,
    overwrite: Annotated[
        bool, Option("--overwrite", help="Replace the weights, from the beginning; else a training goes on.")
    ] = False,
) -> None:
    """Train a learned driver, or a model of scenes, on recordings."""
    weights = _check(kind, data or [], out, overwrite=overwrite)
    absent = [path for path in simulated or () if not path.is_file()]
    if absent:
        raise UsageError(f"--simulated {absent[0]}: no such map")
    if kind == SCENES and simulated:
        raise UsageError(f"train scenes: has no --simulated; only {', '.join(NETWORKS)} do")
    if find_spec("torch") is None:
        raise MissingExtraError("train: needs torch; install with: pip install '.[learned]' in the clone")
    from scex_sumo.evaluation.split import Split

    words = [  # the options on which the result depends
        f"scex-sumo train {kind}",
        *(f"--data {root.name}" for root in data or ()),
        *(f"--simulated {path.name}" for path in simulated or ()),
        f"--seed {seed}",
        *([f"--epochs {epochs}"] if epochs is not None else []),
        *(f"--leave-out {name}" for name in leave_out or ()),
        *(f"--validation {name}" for name in validation or ()),
    ]
    split = Split(kept_validation=tuple(validation or ()))
    recordings = partial(_recordings, data or [], leave_out or [], validation or [])
    if kind == SCENES:
        _train_scenes(recordings(), split, weights, " ".join(words), seed=seed, epochs=epochs)
        return
    from scex_sumo.learned.training.closed_loop import closed_loop
    from scex_sumo.learned.training.data.dataset import SampleOptions, make_dataset
    from scex_sumo.learned.training.train import EPOCHS, Trainer, TrainOptions

    count = EPOCHS[kind] if epochs is None else epochs
    options = TrainOptions(
        kind=kind,  # type: ignore[arg-type]  # checked above
        seed=seed,
        epochs=count,
        rounds=min(TrainOptions.rounds, max(count - 1, 0)),
    )
    recorded, sampling = recordings(), SampleOptions(split=split)
    with progress_bar("samples") as tick:
        dataset = make_dataset(recorded, sampling, maps=simulated or (), tick=tick)
    folder = _checkpoints(weights)
    run = Trainer(dataset, options, drift=closed_loop(recorded, sampling, dataset, options), folder=folder)
    if overwrite and folder.exists():
        shutil.rmtree(folder)
    if run.resume():
        print(f"{folder}: goes on after epoch {run.epoch}")
    try:
        _train(run)
    except KeyboardInterrupt:
        warn([f"{folder}: has the checkpoint after epoch {run.epoch}; the same command goes on"])
        raise
    _finish(run, weights, " ".join(words))
    shutil.rmtree(folder)


def _check(kind: str, roots: Sequence[Path], out: Path | None, *, overwrite: bool) -> Path:
    if kind not in (*NETWORKS, SCENES):
        raise UsageError(f"train {kind}: unknown network; known: {', '.join((*NETWORKS, SCENES))}")
    if out is None:
        raise UsageError("train: needs --out FILE.safetensors for the weights")
    if out.is_dir():
        raise UsageError(f"--out {out}: is a folder; give a file for the weights, e.g. mine.safetensors")
    if not roots:
        raise UsageError("train: needs --data ROOT, a folder with recordings; repeatable")
    missing = next((root for root in roots if not root.exists()), None)
    if missing is not None:
        raise UsageError(f"--data {missing}: no such folder")
    if out.exists() and not overwrite and not _checkpoints(out).exists():  # only a finished one has none
        raise ResultError(f"{out}: exists; --overwrite replaces it")
    if not out.parent.is_dir():
        raise ResultError(f"{out}: folder {out.parent} does not exist; make it first")
    return out


def _train_scenes(
    recordings: Sequence[Recording], split: Split, out: Path, command: str, *, seed: int, epochs: int | None
) -> None:
    import torch

    from scex_sumo.generators.scene_model import save_scenes
    from scex_sumo.learned.training.scenes import EPOCHS, train_scenes

    torch.set_num_threads(1)  # its products are small
    tensors, meta = train_scenes(recordings, split=split, moments=MOMENTS, seed=seed, epochs=epochs or EPOCHS)
    save_scenes(out, tensors, {"command": command, **meta, "seed": seed, "moments": MOMENTS})
    print(
        f"{out}: {meta['scenes']} scenes of {len(meta['sites'])} sites, "
        f"validation loss {meta['validation_loss']}"
    )


def _checkpoints(out: Path) -> Path:
    return out.with_name(out.name + ".training")


def _recordings(
    roots: Sequence[Path], leave_out: Sequence[str], validation: Sequence[str]
) -> tuple[Recording, ...]:
    from scex_sumo.converters.datasets.find import find_recordings, left_out

    recordings = find_recordings(roots)
    warn(left_out(roots))
    sites = sorted({recording.site for recording in recordings})
    names = sorted({recording.name for recording in recordings})
    for option, given, known in (("leave-out", leave_out, sites + names), ("validation", validation, names)):
        unknown = [name for name in given if name not in known]
        if unknown:
            what = "recording" if option == "validation" else "site or recording"
            raise UsageError(f"--{option} {unknown[0]}: no such {what}; known: {', '.join(known)}")
    kept = tuple(r for r in recordings if r.site not in leave_out and r.name not in leave_out)
    if not kept:
        raise UsageError("--leave-out: leaves no recording to train on")
    return kept


def _train(run: Trainer) -> None:
    import torch

    # Else threads add up gradients of indexed rows in the order in which they come.
    torch.use_deterministic_algorithms(True, warn_only=True)
    sites = run.dataset.sites
    print(
        f"{len(run.dataset.train)} scenes to train on, {len(run.dataset.validation)} for validation, of "
        f"{len(sites)} sites; validation: mean and final error over 3 s, m, for " + ", ".join(sites),
        file=sys.stderr,
    )

    def report(progress: Progress) -> None:
        mark = " *" if progress.better else ""
        print(
            f"epoch {progress.epoch}/{run.options.epochs} {progress.seconds:.0f} s "
            f"loss {sum(progress.parts.values()):.3f} validation {progress.score.loss:.3f}  "
            f"{progress.score}{mark}",
            file=sys.stderr,
        )

    with progress_bar(f"train {run.options.kind}") as tick:
        run.run(report, tick)


def _finish(run: Trainer, out: Path, command: str) -> None:
    from scex_sumo.learned.training.loss import score_network
    from scex_sumo.learned.training.networks.graph_image import save_net

    net = run.finished()
    score = score_network(run.predict_mean, run.validation, run.options.weights)
    sites = run.dataset.sites
    figures = {sites[s]: {"ade_m": score.ade[s], "fde_m": score.fde[s]} for s in score.ade}
    meta = {
        "command": command,
        "sites": list(sites),
        "datasets": sorted(set(run.dataset.kinds)),
        "samples": run.dataset.digest,
        "scenes": len(run.dataset.train),
        "epoch": run.best_epoch,
        "validation": figures,
    }
    save_net(out, net, meta)
    print(f"{out}: {run.options.kind}, epoch {run.best_epoch}, {run.seconds:.0f} s")
    for site, errors in figures.items():
        print("  {}: ADE {:.2f} m, FDE {:.2f} m".format(site, *errors.values()))
