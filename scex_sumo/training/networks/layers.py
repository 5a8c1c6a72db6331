"""Building blocks of the networks in training."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

from scex_sumo.behaviors.learned.networks.architecture import SCALED_LIMIT


class ScalerModule(nn.Module):
    """Raw inputs to about zero mean and unit spread, bounded; the figures come from training data."""

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
        """(..., columns) scaled."""
        return ((values - self.mean) / self.spread).clamp(-SCALED_LIMIT, SCALED_LIMIT)


def mlp(*sizes: int) -> nn.Sequential:
    """Linear layers with ReLU between them, none after the last."""
    layers: list[nn.Module] = []
    for index, (inner, outer) in enumerate(pairwise(sizes)):
        layers += [nn.ReLU()] if index else []
        layers.append(nn.Linear(inner, outer))
    return nn.Sequential(*layers)
