"""Training of a learned driver: epochs over samples, rounds in closed loop, checkpoints."""

from __future__ import annotations

import hashlib
import io
import math
import time
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import torch
from torch import Tensor, nn

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.cache import code_key
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.learned.network.architecture import Architecture
from scex_sumo.learned.training.data.batches import Batch, Batches, Images, mirrored
from scex_sumo.learned.training.data.dataset import Dataset
from scex_sumo.learned.training.data.samples import TrainingSamples
from scex_sumo.learned.training.loss import LossWeights, Score, loss, score_network
from scex_sumo.learned.training.networks.graph import JointPredictorNet, ModeTensors, ScalerModule
from scex_sumo.learned.training.networks.graph_image import NETWORKS, Net, save_net

Kind: TypeAlias = Literal["graph", "hybrid", "joint"]
EPOCHS: Mapping[str, int] = {"graph": 6, "hybrid": 6, "joint": 12}  # of the shipped networks


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """Options of a training run."""

    kind: Kind
    seed: int = 0  # of the first weights, the order of batches and all draws
    epochs: int = 6
    rounds: int = 1  # in closed loop, evenly spread over the epochs
    patience: int = 6  # stop after so many epochs without a better validation
    nodes: int = 800  # vehicles per batch, about
    rate: float = 2e-3  # highest learning rate; falls to zero like a cosine
    decay: float = 0.1
    average: float = 0.99  # share of the running mean of the weights that stays at each step
    gradient: float = 1.0
    dropout: float = 0.2  # share of hidden values that is dropped
    noise: float = 0.05  # spread of the noise on scaled inputs, in standard deviations
    unlinked: float = 0.2  # share of the graph's edges that is dropped
    mirror: float = 0.5  # share of the batches that are mirrored
    simulated: float = 0.3  # share of an epoch's vehicles that SUMO drove, if there are such
    balance: float = 0.25  # a site counts like the number of its vehicles to the power of 1 minus this
    sizes: Architecture = field(default_factory=Architecture)
    weights: LossWeights = field(default_factory=LossWeights)  # of the parts of the loss

    def __post_init__(self) -> None:
        if self.epochs < 1 or self.rounds < 0 or self.rounds >= self.epochs:
            raise UsageError(
                f"train: --epochs needs at least 1 and more than the rounds in closed loop; "
                f"got {self.epochs} and {self.rounds}"
            )


Drift: TypeAlias = Callable[[Path, int], TrainingSamples | None]
"""Makes the samples of a round in closed loop, from a network's file and the round's number."""

_MODULES = ("net", "mean", "optimizer")
_NUMBERS = ("epoch", "seconds", "best_epoch", "best_loss")
FILE = "checkpoint.pt"
_DIGEST = hashlib.sha256().digest_size


class Progress(NamedTuple):
    """One epoch, for the log."""

    epoch: int
    seconds: float
    parts: dict[str, float]
    score: Score
    better: bool


class Trainer:
    """One training run.

    Args:
        drift: makes the samples of a round in closed loop; None for no rounds.
        device: None takes a GPU if there is one.
        folder: for checkpoints and the samples of rounds; None keeps none.
    """

    def __init__(
        self,
        dataset: Dataset,
        options: TrainOptions,
        *,
        device: torch.device | None = None,
        drift: Drift | None = None,
        folder: Path | None = None,
    ) -> None:
        self.dataset, self.options, self.drift, self.folder = dataset, options, drift, folder
        self.device = device or torch.device("cuda" if torch.cuda.is_available() else "cpu")
        torch.manual_seed(options.seed)
        self.net: Net = NETWORKS[options.kind](options.sizes)
        self._fit_inputs()
        self.net.to(self.device)
        self.mean = deepcopy(self.net).requires_grad_(False)
        roughen(self.net, options)
        parameters = {
            wide: [p for p in self.net.parameters() if (p.dim() >= 2) == wide] for wide in (True, False)
        }
        # only matrices decay
        groups = [{"params": p, "weight_decay": options.decay * wide} for wide, p in parameters.items()]
        self.optimizer = torch.optim.AdamW(groups, lr=options.rate, betas=(0.9, 0.98))
        self.site_weight = site_weights(dataset, options.balance)
        self.images = Images(dataset.roads, self.device) if options.kind == "hybrid" else None
        self.train = Batches(dataset.train, self.site_weight, self.device)
        self.validation = Batches(dataset.validation, self.site_weight, self.device)
        self.drifted: list[TrainingSamples] = []  # of the rounds in closed loop
        self.epoch, self.best_loss, self.best_epoch, self.seconds = 0, math.inf, 0, 0.0
        self.best = deepcopy(self.mean.state_dict())

    def _fit_inputs(self) -> None:
        """Fit means and spreads of all inputs, and the classes of recorded motions."""
        net, train = self.net, self.dataset.train
        net.scene.node_scale.fit(torch.as_tensor(train.node))
        net.scene.history_scale.fit(torch.as_tensor(train.history).flatten(1))
        net.scene.edge_scale.fit(torch.as_tensor(train.edge))
        net.path_scale.fit(torch.as_tensor(train.feature))
        if isinstance(net, JointPredictorNet):
            net.fit_tokens(*(values[train.right] for values in (train.s, train.d, train.start)))

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
                self.best = deepcopy(self.mean.state_dict())
            self.seconds = time.monotonic() - begun
            if self.folder is not None:
                _write_checkpoint(self.folder, self._state())
            report(Progress(self.epoch, self.seconds, parts, score, better))
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
            self._use_drifted([] if samples is None else [samples])
        self.best_loss = math.inf  # the best so far has not learned to come back

    def _use_drifted(self, samples: list[TrainingSamples]) -> None:
        self.drifted += samples
        if samples:
            train = TrainingSamples.concatenate([self.dataset.train, *self.drifted])
            self.train = Batches(train, self.site_weight, self.device)

    def _epoch(self, tick: Callable[[int, int], None] | None) -> dict[str, float]:
        """Train one epoch; all draws follow from seed and epoch alone, so that runs resume."""
        options = self.options
        rng = np.random.default_rng([options.seed, self.epoch])
        torch.manual_seed(options.seed * 100_003 + self.epoch)
        groups, sums = self._groups(rng), dict[str, float]()
        self.net.train()
        for number, graphs in enumerate(groups):
            done = (self.epoch + number / len(groups)) / options.epochs
            rise, fall = min(1.0, done * options.epochs + 0.02), 0.5 * (1 + math.cos(math.pi * done))
            for group in self.optimizer.param_groups:
                group["lr"] = options.rate * rise * fall
            batch = unlinked(self.train.take(graphs), options.unlinked)
            if mirror := bool(rng.random() < options.mirror):
                batch = mirrored(batch)
            modes = self._predict(self.net, batch, rng, mirror=mirror)
            total, parts = loss(modes, batch, options.weights)
            self.optimizer.zero_grad(set_to_none=True)
            total.backward()  # type: ignore[no-untyped-call]
            nn.utils.clip_grad_norm_(self.net.parameters(), options.gradient)
            self.optimizer.step()
            self._average(number + len(groups) * self.epoch)
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + value / len(groups)
            if tick is not None:
                tick(self.epoch * len(groups) + number + 1, options.epochs * len(groups))
        return sums

    def _groups(self, rng: np.random.Generator) -> list[IntArray]:
        order = self._mixed(rng.permutation(len(self.train.samples)))
        if self.images is None:
            return self.train.groups(order, self.options.nodes)
        site = self.train.samples.site[order]
        groups: list[IntArray] = []
        for number in np.unique(site):
            groups += self.train.groups(order[site == number], self.options.nodes)
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
        inputs: tuple[Any, ...] = (batch.scene, batch.path)
        if self.images is not None:
            turns = 0 if rng is None else int(rng.integers(4))
            count = len(batch.path.node)
            attention = torch.full((count,), 0.5) if rng is None else torch.rand(count)
            inputs += self.images.batch(batch, turns, mirrored=mirror), attention.to(self.device)
        modes: ModeTensors = net(*inputs)
        return modes

    def predict_mean(self, batch: Batch) -> ModeTensors:
        """Predict with the mean weights, the map not turned, and an attention of 0.5."""
        return self._predict(self.mean.eval(), batch, None)

    @torch.no_grad()
    def _average(self, step: int) -> None:
        keep = min(self.options.average, (1 + step) / (10 + step))
        for mean, present in zip(self.mean.parameters(), self.net.parameters(), strict=True):
            mean.lerp_(present, 1 - keep)

    def finished(self) -> Net:
        """Return the network with the best weights, which are now the mean ones."""
        self.mean.load_state_dict(self.best)
        return self.mean.eval()

    def resume(self) -> bool:
        """Go on from the checkpoint in the folder; return False if there is none."""
        state = None if self.folder is None else _read_checkpoint(self.folder / FILE, self.identity())
        if state is None:
            return False
        for name in _MODULES:
            getattr(self, name).load_state_dict(state[name])
        for name in _NUMBERS:
            setattr(self, name, state[name])
        self.best = {k: v.to(self.device) for k, v in state["best"].items()}
        drifted = ({name: v.numpy() for name, v in columns.items()} for columns in state["drifted"])
        self._use_drifted([TrainingSamples(**columns) for columns in drifted])
        return True

    def identity(self) -> dict[str, Any]:
        """Return what a checkpoint and the run that goes on from it have in common."""
        code = hashlib.sha256(code_key()).hexdigest()
        return {"dataset": self.dataset.digest, "code": code, **asdict(self.options)}

    def _state(self) -> dict[str, Any]:
        modules = {name: getattr(self, name).state_dict() for name in _MODULES}
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        drifted = [{k: torch.as_tensor(v) for k, v in vars(samples).items()} for samples in self.drifted]
        return {"identity": self.identity(), "best": self.best, "drifted": drifted, **modules, **numbers}


def _write_checkpoint(folder: Path, state: dict[str, Any]) -> None:
    """Write the SHA-256 of a state, and the state."""
    folder.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    torch.save(state, buffer)
    content = buffer.getvalue()
    write_atomic(folder / FILE, hashlib.sha256(content).digest() + content)


def _read_checkpoint(file: Path, identity: dict[str, Any]) -> dict[str, Any] | None:
    if not file.exists():
        return None
    stored = file.read_bytes()
    digest, content = stored[:_DIGEST], stored[_DIGEST:]
    if hashlib.sha256(content).digest() != digest:
        raise ResultError(f"{file}: not a whole checkpoint of this version; --overwrite begins anew")
    state: dict[str, Any] = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    other = sorted(key for key in identity if state["identity"].get(key) != identity[key])
    if other:
        raise ResultError(
            f"{file}: a checkpoint of a run with another {', '.join(other)}; give the same options and data, "
            "or --overwrite, which begins anew"
        )
    return state


def site_weights(dataset: Dataset, balance: float) -> FloatArray:
    """Return (S,) weights of a site's vehicles; see `TrainOptions.balance`."""
    train = dataset.train
    site = np.repeat(train.site, train.pairs)[train.right]
    count = np.bincount(site, minlength=len(dataset.sites))
    seen = count > 0  # others are for validation alone
    return np.asarray(np.where(seen, (count[seen].mean() / np.maximum(count, 1)) ** balance, 1.0))


def roughen(net: Net, options: TrainOptions) -> None:
    """Add dropout after every ReLU and noise on scaled inputs, in training only."""

    def drop(module: nn.Module, inputs: Any, out: Tensor) -> Tensor:
        return nn.functional.dropout(out, options.dropout, module.training)

    def shake(module: nn.Module, inputs: Any, out: Tensor) -> Tensor:
        return out + options.noise * torch.randn_like(out) if module.training else out

    for module in net.modules():
        if isinstance(module, nn.ReLU):
            module.register_forward_hook(drop)
        if isinstance(module, ScalerModule):
            module.register_forward_hook(shake)


def unlinked(batch: Batch, share: float) -> Batch:
    """Drop a share of a batch's edges."""
    keep = torch.rand(batch.scene.edge.shape[0], device=batch.scene.edge.device) >= share
    scene = batch.scene._replace(edge_index=batch.scene.edge_index[:, keep], edge=batch.scene.edge[keep])
    return replace(batch, scene=scene)
