"""Loss, in which the mode nearest to the recorded future and mode 0 are pulled to it; score of a network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import log_softmax, relu

from scex_sumo.learned.training.data.batches import Batch, Batches
from scex_sumo.learned.training.networks.graph import ModeTensors, TokenTensors, expected_mode, token_errors
from scex_sumo.scene import STEP_S

Predict = Callable[[Batch], ModeTensors | TokenTensors]
NODES = 2000  # per batch, about


@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """Weights of the parts of the loss."""

    expected: float = 1.0  # mode 0 against the recorded future
    winner: float = 0.5  # the nearest mode against it
    relaxed: float = 0.03  # share of the winner's weight that all modes have
    mode: float = 0.15
    path: float = 0.3
    free: float = 0.5
    motion: float = 1.0  # negative log probability of the next 0.5 s (joint)
    whole: float = 0.5  # all parts of its second head
    final: float = 0.5  # weight of the last step besides the mean over all
    sharp_m: float = 0.1  # difference of errors that separates two modes, m
    round_m: float = 0.2  # smaller errors count by their square, m
    acceleration: float = 0.02  # per (m/s²)² beyond `hard`, m/s²
    jerk: float = 0.0005  # per (m/s³)²
    sideways: float = 0.002  # per (m/s²)² of the second change of the offset
    hard: float = 3.0


def displacement(speed: Tensor, acceleration: Tensor) -> Tensor:
    """Return (n, M, H) m along the path from (n,) m/s and (n, M, H) m/s², as `motion.drive` moves."""
    # v' = max(v + a·dt, 0) for all steps at once: the running sum, reflected at its running minimum.
    free = speed[:, None, None] + torch.cumsum(acceleration, 2) * STEP_S
    lowest = torch.clamp(torch.cummin(free, 2).values, max=0.0)
    v = free - lowest
    before = torch.cat([speed[:, None, None].expand(-1, v.shape[1], 1), v[..., :-1]], 2)
    return torch.cumsum((before + v) * (STEP_S / 2), 2)


def trajectory_errors(ahead: Tensor, aside: Tensor, weights: LossWeights) -> Tensor:
    """Return (n, M) rounded errors of trajectories (n, M, H), m: mean over the steps, plus the last one."""
    r = weights.round_m
    distance = torch.sqrt(ahead**2 + aside**2 + r**2) - r
    return distance.mean(2) + weights.final * distance[..., -1]


def loss(
    modes: ModeTensors | TokenTensors, batch: Batch, weights: LossWeights
) -> tuple[Tensor, dict[str, float]]:
    """Return the loss of a batch, and its parts for the log."""
    share, total = batch.share, batch.share.sum().clamp(min=1e-6)
    if isinstance(modes, TokenTensors):
        motion = _mean(token_errors(modes, batch.s, batch.d, batch.start), share, total)
        terms = {
            "motion": weights.motion * motion,
            "path": weights.path * _path_entropy(modes.path_logit, batch),
            "whole": weights.whole * loss(modes.whole, batch, weights)[0],
        }
        return _whole(terms)
    travelled_m = displacement(batch.start[:, 0], modes.acceleration)
    off = trajectory_errors(travelled_m - batch.s[:, None], modes.offset - batch.d[:, None], weights)
    wanted = torch.softmax(-off.detach() / weights.sharp_m, 1)
    terms = {
        "expected": weights.expected * _mean(off[:, 0], share, total),
        "winner": weights.winner * _mean(_winner(off, weights), share, total),
        "mode": weights.mode * _mean(-(wanted * log_softmax(modes.logits, 1)).sum(1), share, total),
        "path": weights.path * _path_entropy(modes.path_logit, batch),
        "smooth": _mean(_roughness(modes, weights), share, total),
    }
    if modes.free is not None:
        gap = modes.free - batch.xy[:, None]
        free = trajectory_errors(gap[..., 0], gap[..., 1], weights)
        terms["free"] = weights.free * _mean(free[:, 0] + _winner(free, weights), share, total)
    return _whole(terms)


def _whole(terms: dict[str, Tensor]) -> tuple[Tensor, dict[str, float]]:
    total = torch.stack(list(terms.values())).sum()
    return total, {name: float(term.detach()) for name, term in terms.items()}


def _mean(values: Tensor, share: Tensor, total: Tensor) -> Tensor:
    return (values * share).sum() / total


def _winner(off: Tensor, weights: LossWeights) -> Tensor:
    nearest = off.min(1).values
    return (1 - weights.relaxed) * nearest + weights.relaxed * off.mean(1)


def _path_entropy(logit: Tensor, batch: Batch) -> Tensor:
    node = batch.path.node
    highest = logit.new_full((int(node.max()) + 1 if len(node) else 0,), -torch.inf)
    highest = highest.scatter_reduce(0, node, logit.detach(), "amax")
    odds = torch.exp(logit - highest[node])  # 1 of a vehicle's likeliest path
    zeros = torch.zeros_like(highest)
    all_odds, right_odds = (zeros.index_add(0, node, values) for values in (odds, odds * batch.right))
    weight = zeros.index_add(0, node, batch.share.to(all_odds.dtype))
    known = weight > 0
    entropy = torch.log(all_odds[known]) - torch.log(right_odds[known].clamp(min=1e-6))
    return (entropy * weight[known]).sum() / weight[known].sum().clamp(min=1e-6)


def _roughness(modes: ModeTensors, weights: LossWeights) -> Tensor:
    a = modes.acceleration
    cost = weights.acceleration * (relu(a.abs() - weights.hard) ** 2).mean((1, 2))
    jerk = torch.diff(a, dim=2) / STEP_S
    cost = cost + weights.jerk * (jerk**2).mean((1, 2))
    bend = torch.diff(modes.offset, n=2, dim=2) / STEP_S**2
    return cost + weights.sideways * (bend**2).mean((1, 2))


@dataclass(frozen=True, kw_only=True)
class Score:
    """Errors of the expected mode on the likeliest path over the vehicles of some samples, in m, by site."""

    loss: float  # mean over batches, weighted as in training
    ade: dict[int, float]  # mean distance over 3 s
    fde: dict[int, float]  # distance after 3 s

    def __str__(self) -> str:
        """ADE/FDE by site."""
        return "  ".join(f"{self.ade[s]:.2f}/{self.fde[s]:.2f}" for s in self.ade)


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
            modes = expected_mode(modes, batch.start[:, 1])
        rows.append(_vehicles(modes, batch).cpu())
    vehicles = torch.cat(rows).numpy()
    by_site = {int(s): vehicles[vehicles[:, 0] == s] for s in np.unique(vehicles[:, 0])}
    ade, fde = ({s: float(v[:, k].mean()) for s, v in by_site.items()} for k in (1, 2))
    return Score(loss=total / max(count, 1e-9), ade=ade, fde=fde)


def _vehicles(modes: ModeTensors, batch: Batch) -> Tensor:
    travelled_m = displacement(batch.start[:, 0], modes.acceleration[:, :1])[:, 0]
    off = torch.hypot(travelled_m - batch.s, modes.offset[:, 0] - batch.d)
    node = batch.path.node
    # Sorted by vehicle, then by falling logit: the first of each vehicle is its likeliest path.
    order = torch.argsort(modes.path_logit, descending=True, stable=True)
    order = order[torch.argsort(node[order], stable=True)]
    owner = node[order]
    top = order[torch.cat([owner.new_ones(1), torch.diff(owner)]) > 0]
    return torch.stack([batch.site[top].float(), off[top].mean(1), off[top, -1]], 1)
