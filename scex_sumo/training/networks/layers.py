"""Building blocks of the networks in training: scaling, linear layers, attention along edges."""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from torch import Tensor, nn

from scex_sumo.behaviors.learned.architecture import SCALED_LIMIT, SLOPE


class ScalerModule(nn.Module):
    """Scales raw inputs to about zero mean and unit spread, bounded."""

    mean: Tensor
    spread: Tensor

    def __init__(self, columns: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(columns))
        self.register_buffer("spread", torch.ones(columns))

    def fit(self, values: Tensor) -> None:
        """Take mean and standard deviation from (n, columns) values; constant columns keep their scale."""
        spread, mean = torch.std_mean(values.double(), dim=0)
        self.mean.copy_(mean)
        self.spread.copy_(torch.where(spread > 1e-6, spread, torch.ones_like(spread)))

    def forward(self, values: Tensor) -> Tensor:
        """Return (n, columns) scaled."""
        return ((values - self.mean) / self.spread).clamp(-SCALED_LIMIT, SCALED_LIMIT)


def mlp(*sizes: int) -> nn.Sequential:
    """Return linear layers with ReLU between them."""
    layers: list[nn.Module] = []
    for index, (inner, outer) in enumerate(pairwise(sizes)):
        layers += [nn.ReLU()] if index else []
        layers.append(nn.Linear(inner, outer))
    return nn.Sequential(*layers)


class EdgeAttentionModule(nn.Module):
    """Attention of several heads over the edges to a node (GATv2), with the numbers of PyTorch Geometric."""

    def __init__(self, inner: int, each: int, *, heads: int, edge_columns: int) -> None:
        super().__init__()
        self.lin_l = nn.Linear(inner, heads * each)
        self.lin_r = nn.Linear(inner, heads * each)
        self.lin_edge = nn.Linear(edge_columns, heads * each, bias=False)
        self.att = nn.Parameter(torch.empty(1, heads, each))
        self.bias = nn.Parameter(torch.zeros(heads * each))
        for layer in (self.lin_l, self.lin_r, self.lin_edge):
            _draw(layer.weight)
            if layer.bias is not None:
                nn.init.uniform_(layer.bias, -1 / math.sqrt(inner), 1 / math.sqrt(inner))
        _draw(self.att)

    def forward(self, node: Tensor, edge_index: Tensor, edge: Tensor, asking: Tensor | None = None) -> Tensor:
        """Return (K, heads * each) of nodes that ask.

        Args:
            node: (N, inner).
            edge_index: (2, E) source among the nodes, target among those that ask.
            edge: (E, columns).
            asking: (K, inner).
        """
        heads, each = self.att.shape[1:]
        source, target = edge_index
        asking = node if asking is None else asking
        given = self.lin_l(node).view(-1, heads, each).index_select(0, source)
        asked = self.lin_r(asking).view(-1, heads, each).index_select(0, target)
        mixed = asked + given + self.lin_edge(edge).view(-1, heads, each)
        score = (nn.functional.leaky_relu(mixed, SLOPE) * self.att).sum(dim=-1)
        weight = _softmax(score, target, len(asking))
        taken = _sum(given * weight.unsqueeze(-1), target, len(asking))
        out: Tensor = taken.view(-1, heads * each) + self.bias
        return out


def _draw(weight: Tensor) -> None:
    """Draw uniform numbers that keep the variance from layer to layer (Glorot, Bengio 2010)."""
    bound = math.sqrt(6.0 / (weight.size(-2) + weight.size(-1)))
    nn.init.uniform_(weight, -bound, bound)


def _softmax(score: Tensor, target: Tensor, nodes: int) -> Tensor:
    """Return (E, heads) weights that add up to 1 over the edges to each node."""
    at = target.view(-1, 1).expand_as(score)
    largest = score.new_zeros(nodes, score.shape[1])
    largest = largest.scatter_reduce(0, at, score.detach(), "amax", include_self=False)
    raised = (score - largest.index_select(0, target)).exp()
    total = _sum(raised, target, nodes) + 1e-16
    return raised / total.index_select(0, target)


def _sum(values: Tensor, target: Tensor, nodes: int) -> Tensor:
    """Return (N, ...) sums of (E, ...) values over the edges to each node."""
    at = target.view(-1, *[1] * (values.dim() - 1)).expand_as(values)
    return values.new_zeros(nodes, *values.shape[1:]).scatter_add(0, at, values)
