"""Training of a learned driver: epochs over samples, rounds in closed loop, checkpoints."""

from __future__ import annotations

import hashlib
import io
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import nn

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.cache import code_key
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import sha256_of, write_atomic
from scex_sumo.learned.network.architecture import Architecture
from scex_sumo.learned.training.data.augment import Images, mirrored
from scex_sumo.learned.training.data.batches import Batch, Batches
from scex_sumo.learned.training.data.dataset import Dataset
from scex_sumo.learned.training.data.samples import TrainingSamples, load_samples, save_samples
from scex_sumo.learned.training.loss import loss
from scex_sumo.learned.training.networks.graph import ModeTensors
from scex_sumo.learned.training.networks.graph_image import NETWORKS, Net, save_net
from scex_sumo.learned.training.networks.joint import JointPredictorNet
from scex_sumo.learned.training.options import (
    TrainOptions,
    copied,
    fit_scales,
    learning_rate,
    roughen,
    site_weights,
    unlinked,
    weight_groups,
)
from scex_sumo.learned.training.validate import Score, score_network

Drift: TypeAlias = Callable[[Path, int], TrainingSamples | None]
"""Makes the samples of a round in closed loop, from a network's file and the round's number."""

_MODULES = ("net", "mean", "optimizer")
_NUMBERS = ("epoch", "seconds", "best_epoch", "best_loss")
FILE = "checkpoint.pt"
_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True, kw_only=True, eq=False)
class Progress:
    """One epoch, for the log."""

    epoch: int
    epochs: int
    seconds: float
    parts: dict[str, float]
    score: Score
    better: bool


def device_of(name: str) -> torch.device:
    """Return a device by name; ``auto`` takes a GPU if there is one."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:
        words = str(error).splitlines()[0]
        raise UsageError(f"--device {name}: cannot be used ({words}); give cpu, cuda or auto") from None
    return device


class Trainer:
    """One training run.

    Args:
        drift: makes the samples of a round in closed loop; None for no rounds.
        folder: for checkpoints and the samples of rounds; None keeps none.
    """

    def __init__(
        self,
        dataset: Dataset,
        options: TrainOptions,
        *,
        device: torch.device,
        drift: Drift | None = None,
        folder: Path | None = None,
    ) -> None:
        self.dataset, self.options, self.device, self.folder = dataset, options, device, folder
        self.drift = drift if options.rounds else None
        torch.manual_seed(options.seed)
        self.net: Net = NETWORKS[options.kind](Architecture(**options.sizes))
        fit_scales(self.net, dataset.train)
        if isinstance(self.net, JointPredictorNet):
            train, right = dataset.train, dataset.train.right
            self.net.fit_tokens(train.s[right], train.d[right], train.start[right])
        self.net.to(device)
        self.mean = copied(self.net)
        roughen(self.net, options)
        self.optimizer = torch.optim.AdamW(
            weight_groups(self.net, options.decay), lr=options.rate, betas=(0.9, 0.98)
        )
        self.site_weight = site_weights(dataset, options.balance)
        self.images = Images.of_roads(dataset.roads, device) if options.kind == "hybrid" else None
        self.train = Batches(dataset.train, self.site_weight, device)
        self.validation = Batches(dataset.validation, self.site_weight, device)
        self.drifted: list[TrainingSamples] = []
        self.rounds: list[str] = []  # SHA-256 of their files
        self.epoch, self.best_loss, self.best_epoch, self.seconds = 0, math.inf, 0, 0.0
        self.best = {k: v.clone() for k, v in self.mean.state_dict().items()}

    def run(self, report: Callable[[Progress], None], tick: Callable[[int, int], None] | None = None) -> None:
        """Train until epochs, time or patience end; ``tick`` gets the number of batches done, and of all."""
        options, begun = self.options, time.monotonic() - self.seconds
        while self.epoch < options.epochs:
            self._round()
            parts = self._epoch(tick)
            self.epoch += 1
            score = score_network(self.predict_mean, self.validation, options.weights)
            better = score.loss < self.best_loss
            if better:
                self.best_loss, self.best_epoch = score.loss, self.epoch
                self.best = {k: v.clone() for k, v in self.mean.state_dict().items()}
            self.seconds = time.monotonic() - begun
            if self.folder is not None:
                _write_checkpoint(self.folder, self._state())
            report(Progress(epoch=self.epoch, epochs=options.epochs, seconds=self.seconds, parts=parts,
                            score=score, better=better))  # fmt: skip
            if self.epoch - self.best_epoch >= options.patience:
                return

    def _round(self) -> None:
        options = self.options
        due = [round((k + 1) * options.epochs / (options.rounds + 1)) for k in range(options.rounds)]
        if self.drift is None or self.folder is None or self.epoch not in due:
            return
        number = due.index(self.epoch)
        if len(self.drifted) <= number:
            file = self.folder / "policy.safetensors"
            save_net(file, self.mean, {})
            samples = self.drift(file, number)
            file.unlink()
            if samples is not None:
                self.drifted.append(samples)
                save_samples(_round_file(self.folder, number), samples)
                self.rounds.append(sha256_of(_round_file(self.folder, number)))
                self._use_drifted()
        self.best_loss = math.inf  # the best so far has not learned to come back

    def _use_drifted(self) -> None:
        whole = TrainingSamples.concatenate([self.dataset.train, *self.drifted])
        self.train = Batches(whole, self.site_weight, self.device)

    def _epoch(self, tick: Callable[[int, int], None] | None) -> dict[str, float]:
        """Train one epoch; all draws follow from seed and epoch alone, so that runs resume."""
        options = self.options
        rng = np.random.default_rng([options.seed, self.epoch])
        torch.manual_seed(options.seed * 100_003 + self.epoch)
        groups = self._groups(rng)
        sums: dict[str, float] = {}
        self.net.train()
        for number, graphs in enumerate(groups):
            done = (self.epoch + number / len(groups)) / options.epochs
            for group in self.optimizer.param_groups:
                group["lr"] = learning_rate(options, done)
            batch = unlinked(self.train.take(graphs), options.unlinked)
            mirror = bool(rng.random() < options.mirror)
            batch = mirrored(batch) if mirror else batch
            modes = self._predict(self.net, batch, rng, mirror=mirror)
            whole, parts = loss(modes, batch, options.weights)
            self.optimizer.zero_grad(set_to_none=True)
            whole.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self.net.parameters(), options.gradient)
            self.optimizer.step()
            self._average(number + len(groups) * self.epoch)
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + value / len(groups)
            if tick is not None:
                tick(self.epoch * len(groups) + number + 1, options.epochs * len(groups))
        return sums

    def _groups(self, rng: np.random.Generator) -> list[Any]:
        order = self._mixed(rng.permutation(len(self.train.samples)))
        if self.images is None:
            return self.train.groups(order, self.options.nodes)
        site = self.train.samples.site[order]
        groups = [
            group
            for s in np.unique(site)
            for group in self.train.groups(order[site == s], self.options.nodes)
        ]
        return [groups[k] for k in rng.permutation(len(groups))]

    def _mixed(self, order: IntArray) -> IntArray:
        """Keep as many simulated graphs of an order as `TrainOptions.simulated` says."""
        nodes, share = self.train.samples.nodes[order], self.options.simulated
        simulated = (order >= self.dataset.recorded) & (order < len(self.dataset.train))
        most = nodes[~simulated].sum() * share / (1 - share)
        return np.asarray(order[~simulated | (np.cumsum(nodes * simulated) <= most)])

    def _predict(
        self, net: Net, batch: Batch, rng: np.random.Generator | None, *, mirror: bool = False
    ) -> ModeTensors:
        if self.images is None:
            modes: ModeTensors = net(batch.scene, batch.path)
            return modes
        turns = 0 if rng is None else int(rng.integers(4))
        count = len(batch.path.node)
        attention = torch.full((count,), 0.5) if rng is None else torch.rand(count)
        image = self.images.batch(batch, turns, mirrored=mirror)
        seen: ModeTensors = net(batch.scene, batch.path, image, attention.to(self.device))
        return seen

    def predict_mean(self, batch: Batch) -> ModeTensors:
        """Predict with the mean weights, the map not turned, and an attention of 0.5."""
        return self._predict(self.mean.eval(), batch, None)

    @torch.no_grad()
    def _average(self, step: int) -> None:
        keep = min(self.options.average, (1 + step) / (10 + step))
        for mean, present in zip(self.mean.parameters(), self.net.parameters(), strict=True):
            mean.lerp_(present, 1 - keep)

    def finished(self) -> Net:
        """Return the network with the best weights."""
        net = copied(self.mean)
        net.load_state_dict(self.best)
        return net.cpu().eval()

    def resume(self) -> bool:
        """Go on from the checkpoint in the folder; return False if there is none."""
        if self.folder is None:
            return False
        checkpoint = _read_checkpoint(self.folder, self.identity())
        if checkpoint is None:
            return False
        state, self.drifted = checkpoint
        self._restore(state)
        if self.drifted:
            self._use_drifted()
        return True

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the run that goes on from it have in common."""
        code = hashlib.sha256(code_key()).hexdigest()
        return {"dataset": self.dataset.digest, "code": code, **asdict(self.options)}

    def _state(self) -> dict[str, Any]:
        modules = {name: getattr(self, name).state_dict() for name in _MODULES}
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        return {"identity": self.identity(), "best": self.best, "rounds": self.rounds, **modules, **numbers}

    def _restore(self, state: dict[str, Any]) -> None:
        for name in _MODULES:
            getattr(self, name).load_state_dict(state[name])
        for name in _NUMBERS:
            setattr(self, name, state[name])
        self.rounds = state["rounds"]
        self.best = {k: v.to(self.device) for k, v in state["best"].items()}


def _round_file(folder: Path, number: int) -> Path:
    return folder / f"round{number}.npz"


def _write_checkpoint(folder: Path, state: dict[str, Any]) -> None:
    """Write the SHA-256 of a state, and the state."""
    folder.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    torch.save(state, buffer)
    content = buffer.getvalue()
    write_atomic(folder / FILE, hashlib.sha256(content).digest() + content)


def _read_checkpoint(
    folder: Path, identity: dict[str, Any]
) -> tuple[dict[str, Any], list[TrainingSamples]] | None:
    file = folder / FILE
    if not file.exists():
        return None
    whole = file.read_bytes()
    digest, content = whole[:_DIGEST], whole[_DIGEST:]
    if hashlib.sha256(content).digest() != digest:
        raise ResultError(f"{file}: not a whole checkpoint of this version; --overwrite begins anew")
    state: dict[str, Any] = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    other = sorted(key for key in identity if state["identity"].get(key) != identity[key])
    if other:
        raise ResultError(
            f"{file}: a checkpoint of a run with another {', '.join(other)}; give the same options and data, "
            "or --overwrite, which begins anew"
        )
    drifted = []
    for number, known in enumerate(state["rounds"]):
        file = _round_file(folder, number)
        samples = load_samples(file) if file.exists() and sha256_of(file) == known else None
        if samples is None:
            raise ResultError(f"{file}: is not that of the checkpoint; --overwrite begins anew")
        drifted.append(samples)
    return state, drifted
