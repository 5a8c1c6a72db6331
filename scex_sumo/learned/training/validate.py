"""Validation of a network on its part of the recordings, without driving."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from scex_sumo.learned.training.data.batches import Batch, Batches
from scex_sumo.learned.training.loss import LossWeights, displacement, loss
from scex_sumo.learned.training.networks.graph import ModeTensors
from scex_sumo.learned.training.networks.joint import TokenTensors, likely_modes

Predict = Callable[[Batch], ModeTensors | TokenTensors]
GUESSES = 6
NODES = 2000  # per batch, about


@dataclass(frozen=True, kw_only=True)
class Score:
    """Errors over the vehicles of some samples, in m and by site.

    Attributes:
        best: distance after 3 s of the best of the six likeliest combinations of path and mode.
    """

    loss: float  # mean over batches, weighted as in training
    ade: dict[int, float]  # mean distance over 3 s of the expected mode on the likeliest path
    fde: dict[int, float]  # its distance after 3 s
    best: dict[int, float]

    def __str__(self) -> str:
        """ADE/FDE/best of six by site."""
        return "  ".join(f"{self.ade[s]:.2f}/{self.fde[s]:.2f}/{self.best[s]:.2f}" for s in self.ade)


@torch.no_grad()
def score_network(predict: Predict, batches: Batches, weights: LossWeights) -> Score:
    """Score a network on all samples of `batches`."""
    rows: list[Tensor] = []
    total = count = 0.0
    weights = replace(weights, whole=0.0)  # that head is for training alone
    # one site per batch, as the image branch has them in training
    order = np.argsort(batches.samples.site, kind="stable")
    for graphs in batches.groups(order, NODES):
        batch = batches.take(graphs)
        modes = predict(batch)
        share = float(batch.share.sum())
        total += share * float(loss(modes, batch, weights)[0])
        count += share
        if isinstance(modes, TokenTensors):
            modes = likely_modes(modes, batch.start[:, 1], GUESSES)
        rows.append(_vehicles(modes, batch).cpu())
    every = torch.cat(rows).numpy()
    sites = [int(s) for s in np.unique(every[:, 0])]
    by_site = {s: every[every[:, 0] == s] for s in sites}
    return Score(
        loss=total / max(count, 1e-9),
        ade={s: float(v[:, 1].mean()) for s, v in by_site.items()},
        fde={s: float(v[:, 2].mean()) for s, v in by_site.items()},
        best={s: float(v[:, 3].mean()) for s, v in by_site.items()},
    )


def _vehicles(modes: ModeTensors, batch: Batch) -> Tensor:
    off = _distances(modes, batch)
    node, ends = batch.path.node, off[..., -1]
    count = int(node.max()) + 1
    # Sorted by vehicle, then by falling logit: the first of each vehicle is its likeliest path.
    order = torch.argsort(modes.path_logit, descending=True, stable=True)
    order = order[torch.argsort(node[order], stable=True)]
    owner = node[order]
    first = torch.cat([owner.new_ones(1), torch.diff(owner)]) > 0
    top = order[first]
    best = _best(modes, node, ends, count)[node[top]]
    return torch.stack([batch.site[top].float(), off[top, 0].mean(1), ends[top, 0], best], 1)


def _distances(modes: ModeTensors, batch: Batch) -> Tensor:
    travelled_m = displacement(batch.start[:, 0], modes.acceleration)
    return torch.hypot(travelled_m - batch.s[:, None], modes.offset - batch.d[:, None])


def _best(modes: ModeTensors, node: Tensor, ends: Tensor, count: int) -> Tensor:
    highest = torch.full((count,), -torch.inf, device=node.device)
    highest = highest.scatter_reduce(0, node, modes.path_logit, "amax")
    each = torch.exp(modes.path_logit - highest[node])
    every = torch.zeros(count, device=node.device).index_add(0, node, each)
    likely = torch.softmax(modes.logits, 1) * (each / every[node])[:, None]
    owner = node[:, None].expand_as(likely).reshape(-1)
    # By vehicle, then by falling probability.
    order = torch.argsort(likely.reshape(-1), descending=True, stable=True)
    order = order[torch.argsort(owner[order], stable=True)]
    owner = owner[order]
    first = torch.searchsorted(owner.contiguous(), owner.contiguous())
    rank = torch.arange(len(owner), device=node.device) - first
    kept = order[rank < GUESSES]
    best = torch.full((count,), torch.inf, device=node.device)
    return best.scatter_reduce(0, owner[rank < GUESSES], ends.reshape(-1)[kept], "amin")
