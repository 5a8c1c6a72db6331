"""``scex-sumo train``: train a learned driver on recordings."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scex_sumo.behaviors.learned.extra import check_libraries
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.errors import ResultError, UsageError

if TYPE_CHECKING:
    from scex_sumo.training.data.dataset import Dataset
    from scex_sumo.training.train import Progress, Trainer

KINDS = ("graph", "hybrid")


@dataclass(frozen=True, kw_only=True)
class TrainRequest:
    """What the user asked for; see ``scex-sumo train --help``."""

    kind: str
    roots: tuple[Path, ...]
    out: Path | None
    seed: int = 0
    epochs: int | None = None
    rounds: int | None = None
    minutes: float = 0.0
    device: str = "auto"
    resume: bool = False
    every_s: float = 0.5
    leave_out: tuple[str, ...] = ()
    edges: bool = True
    cache: Path | None = None
    overwrite: bool = False


def train_command(request: TrainRequest) -> None:
    """Make the samples, train, write the weights, and say how well they predict the validation part."""
    _check(request)
    check_libraries("train")
    from scex_sumo.training.device import device_of
    from scex_sumo.training.options import TrainOptions
    from scex_sumo.training.train import Trainer

    assert request.out is not None
    device = device_of(request.device)
    dataset, rooms = _dataset(request)
    options = TrainOptions(
        kind=request.kind,  # type: ignore[arg-type]  # checked above
        seed=request.seed,
        minutes=request.minutes,
        epochs=TrainOptions.epochs if request.epochs is None else request.epochs,
        rounds=TrainOptions.rounds if request.rounds is None else request.rounds,
        sizes={} if request.edges else {"edges": False},
    )
    folder = _checkpoints(request.out)
    run = Trainer(dataset, options, device=device, drift=rooms(options), folder=folder)
    if request.resume:
        if not run.resume():
            warn([f"{folder}: no checkpoint in it; training from the beginning"])
    elif folder.exists():
        shutil.rmtree(folder)
    try:
        _train(run)
    except KeyboardInterrupt:
        warn([f"{folder}: has the checkpoint after epoch {run.epoch}; go on with --resume"])
        raise
    _finish(run, request)
    shutil.rmtree(folder)


def _check(request: TrainRequest) -> None:
    if request.kind not in KINDS:
        raise UsageError(f"train {request.kind}: unknown network; known: {', '.join(KINDS)}")
    if request.out is None:
        raise UsageError("train: needs --out FILE.pt for the weights")
    if not request.roots:
        raise UsageError("train: needs --data ROOT, a folder with recordings; repeatable")
    missing = next((root for root in request.roots if not root.exists()), None)
    if missing is not None:
        raise UsageError(f"--data {missing}: no such folder")
    goes_on = request.resume and _checkpoints(request.out).exists()  # a finished training has none
    if request.out.exists() and not (request.overwrite or goes_on):
        raise ResultError(f"{request.out}: exists; --overwrite replaces it")
    if not request.out.parent.is_dir():
        raise ResultError(f"{request.out}: folder {request.out.parent} does not exist; make it first")
    if request.every_s <= 0 or request.minutes < 0:
        raise UsageError("train: --every needs a positive number of seconds, --minutes none below 0")
    if (request.epochs is not None and request.epochs < 1) or (request.rounds or 0) < 0:
        raise UsageError("train: --epochs needs at least 1, --rounds at least 0")


def _checkpoints(out: Path) -> Path:
    """The folder of a training that is under way."""
    return out.with_name(out.name + ".training")


def _dataset(request: TrainRequest) -> tuple[Dataset, Any]:
    """The samples, and a function of the options that gives what drives in closed loop."""
    from scex_sumo.converters.datasets.recordings import find_recordings
    from scex_sumo.training.data.dataset import SampleOptions, default_cache, make_dataset
    from scex_sumo.training.drift import closed_loop

    recordings = find_recordings(request.roots)
    sites = sorted({recording.site for recording in recordings})
    unknown = [name for name in request.leave_out if name not in sites]
    if unknown:
        raise UsageError(f"--leave-out {unknown[0]}: no such site; known: {', '.join(sites)}")
    kept = tuple(r for r in recordings if r.site not in request.leave_out)
    if not kept:
        raise UsageError("--leave-out: leaves no recording to train on")
    sampling = SampleOptions(every_s=request.every_s)
    cache = default_cache() if request.cache is None else request.cache
    with progress_bar("samples") as tick:
        dataset = make_dataset(kept, sampling, cache=cache, tick=tick)

    def loop(options: Any) -> Any:
        return closed_loop(kept, sampling, dataset.sites, options)

    return dataset, loop


def _train(run: Trainer) -> None:
    sites = run.dataset.sites
    print(
        f"{len(run.dataset.train)} scenes to train on, {len(run.dataset.validation)} for validation, of "
        f"{len(sites)} sites; validation: mean/final error after 3 s and best of six, m, for "
        + ", ".join(sites),
        file=sys.stderr,
    )

    def report(progress: Progress) -> None:
        mark = " *" if progress.better else ""
        print(
            f"epoch {progress.epoch}/{progress.epochs} {progress.seconds:.0f} s "
            f"loss {sum(progress.parts.values()):.3f} validation {progress.score.loss:.3f}  "
            f"{progress.score}{mark}",
            file=sys.stderr,
        )

    with progress_bar(f"train {run.options.kind}") as tick:
        run.run(report, tick)


def _finish(run: Trainer, request: TrainRequest) -> None:
    from scex_sumo.behaviors.learned.weights import save_weights
    from scex_sumo.training.validate import validate

    assert request.out is not None
    run.mean.load_state_dict(run.best)
    score = validate(run.predict_mean, run.validation, run.options.weights)
    sites = run.dataset.sites
    figures = {
        sites[s]: {"ade_m": score.ade[s], "fde_m": score.fde[s], "best_of_6_m": score.best[s]}
        for s in score.ade
    }
    meta = {
        "command": _words(request),
        "sites": list(sites),
        "datasets": sorted(set(run.dataset.kinds)),
        "samples": run.dataset.digest,
        "scenes": len(run.dataset.train),
        "epoch": run.best_epoch,
        "seconds": round(run.seconds),
        "validation": figures,
    }
    save_weights(request.out, run.finished(), meta)
    print(f"{request.out}: {run.options.kind}, epoch {run.best_epoch}, {run.seconds:.0f} s")
    for site, found in figures.items():
        print(
            f"  {site}: ADE {found['ade_m']:.2f} m, FDE {found['fde_m']:.2f} m, "
            f"best of six {found['best_of_6_m']:.2f} m"
        )


def _words(request: TrainRequest) -> str:
    """The command line without what the result does not depend on."""
    words: Sequence[str] = [
        "scex-sumo train",
        request.kind,
        *(f"--data {root.name}" for root in request.roots),
        f"--seed {request.seed}",
        *([f"--epochs {request.epochs}"] if request.epochs is not None else []),
        *([f"--rounds {request.rounds}"] if request.rounds is not None else []),
        *(f"--leave-out {site}" for site in request.leave_out),
        *(["--no-edges"] if not request.edges else []),
        f"--every {request.every_s:g}",
    ]
    return " ".join(words)
