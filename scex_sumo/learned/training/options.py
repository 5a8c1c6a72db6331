"""Options of a training run, and their effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np
import torch
from torch import Tensor, nn

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import UsageError
from scex_sumo.learned.training.data.batches import Batch
from scex_sumo.learned.training.data.dataset import Dataset
from scex_sumo.learned.training.data.samples import TrainingSamples
from scex_sumo.learned.training.loss import LossWeights
from scex_sumo.learned.training.networks.graph import ScalerModule
from scex_sumo.learned.training.networks.graph_image import Net

Kind: TypeAlias = Literal["graph", "hybrid", "joint"]
EPOCHS: Mapping[str, int] = {"graph": 6, "hybrid": 6, "joint": 12}  # of the shipped networks


@dataclass(frozen=True, kw_only=True)
class TrainOptions:
    """Options of a training run.

    Attributes:
        average: share of the running mean of the weights that stays at each step; the mean is kept.
        sizes: numbers of `Architecture` that differ from the shipped ones.
    """

    kind: Kind
    seed: int = 0  # of the first weights, the order of batches and all draws
    epochs: int = 6
    rounds: int = 1  # in closed loop, evenly spread over the epochs
    patience: int = 6  # stop after so many epochs without a better validation
    nodes: int = 800  # vehicles per batch, about
    rate: float = 2e-3  # highest learning rate; falls to zero like a cosine
    decay: float = 0.1
    average: float = 0.99
    gradient: float = 1.0
    dropout: float = 0.2  # share of hidden values that is dropped
    noise: float = 0.05  # spread of the noise on scaled inputs, in standard deviations
    unlinked: float = 0.2  # share of the graph's edges that is dropped
    mirror: float = 0.5  # share of the batches that are mirrored
    simulated: float = 0.3  # share of an epoch's vehicles that SUMO drove, if there are such
    balance: float = 0.25  # a site counts like the number of its vehicles to the power of 1 minus this
    sizes: dict[str, Any] = field(default_factory=dict)
    weights: LossWeights = field(default_factory=LossWeights)  # of the parts of the loss

    def __post_init__(self) -> None:
        if self.epochs < 1 or self.rounds < 0 or self.rounds >= self.epochs:
            raise UsageError(
                f"train: --epochs needs at least 1 and more than the rounds in closed loop; "
                f"got {self.epochs} and {self.rounds}"
            )


def site_weights(dataset: Dataset, balance: float) -> FloatArray:
    """Return (S,) weights of a site's vehicles; see `TrainOptions.balance`."""
    train = dataset.train
    site = np.repeat(train.site, train.pairs)[train.right]
    count = np.bincount(site, minlength=len(dataset.sites))
    seen = count > 0  # others are for validation alone
    weight: FloatArray = np.where(seen, (count[seen].mean() / np.maximum(count, 1)) ** balance, 1.0)
    return weight


def learning_rate(options: TrainOptions, done: float) -> float:
    """Return the learning rate after a share of the training."""
    rise = min(1.0, (done * options.epochs + 0.02) / 1.0)
    return options.rate * rise * 0.5 * (1 + math.cos(math.pi * done))


def weight_groups(net: nn.Module, decay: float) -> list[dict[str, Any]]:
    """Return parameters for the optimizer; only matrices decay."""
    matrices = [p for p in net.parameters() if p.dim() >= 2]
    others = [p for p in net.parameters() if p.dim() < 2]
    return [{"params": matrices, "weight_decay": decay}, {"params": others, "weight_decay": 0.0}]


def copied(net: Net) -> Net:
    """Return a copy that is not trained."""
    return deepcopy(net).requires_grad_(False)


def roughen(net: Net, options: TrainOptions) -> None:
    """Add dropout after every ReLU and noise on scaled inputs, in training only."""

    def drop(module: nn.Module, given: Any, out: Tensor) -> Tensor:
        return nn.functional.dropout(out, options.dropout, module.training)

    def shake(module: nn.Module, given: Any, out: Tensor) -> Tensor:
        return out + options.noise * torch.randn_like(out) if module.training else out

    for module in net.modules():
        if isinstance(module, nn.ReLU) and options.dropout:
            module.register_forward_hook(drop)
        if isinstance(module, ScalerModule) and options.noise:
            module.register_forward_hook(shake)


def unlinked(batch: Batch, share: float) -> Batch:
    """Drop a share of a batch's edges."""
    if not share:
        return batch
    keep = torch.rand(batch.scene.edge.shape[0], device=batch.scene.edge.device) >= share
    scene = batch.scene._replace(edge_index=batch.scene.edge_index[:, keep], edge=batch.scene.edge[keep])
    return replace(batch, scene=scene)


def fit_scales(net: Net, samples: TrainingSamples) -> None:
    """Fit means and spreads of all inputs."""
    net.scene.node_scale.fit(torch.as_tensor(samples.node))
    net.scene.history_scale.fit(torch.as_tensor(samples.history).flatten(1))
    net.scene.edge_scale.fit(torch.as_tensor(samples.edge))
    net.path_scale.fit(torch.as_tensor(samples.feature))
