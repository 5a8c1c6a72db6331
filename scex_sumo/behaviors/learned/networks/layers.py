"""Building blocks of the networks, and the arithmetic that makes their results independent of the batch.

A float sum depends on its order, and libraries choose another order for another number of rows: the same
vehicle would get another last bit in a larger batch, which a closed loop turns into another child. When
running, therefore, networks compute in float64 with the inputs of every matrix product and all weights
rounded to multiples of powers of two. Every product and partial sum then fits into the 53 bits of a float64
exactly, in whatever order it is summed. What is left to normalisation and softmax, which work on one row or
one vehicle's edges, is rounded away by the next product's grid. In training (float32) nothing is rounded.
"""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

INPUT_GRID = 2.0**-14
WEIGHT_GRID = 2.0**-20
INPUT_LIMIT = 2.0**8
# Sum of |weight| per output below which every partial sum is exact: 2^53 grid steps of the products.
WEIGHT_SUM_LIMIT = 2.0**53 * INPUT_GRID * WEIGHT_GRID / INPUT_LIMIT
SCALED_LIMIT = 10.0  # standard deviations that an input may be off its mean


def snapped(values: Tensor) -> Tensor:
    """Values on the grid on which products are exact; unchanged unless they are float64."""
    if values.dtype != torch.float64:
        return values
    return (values * (1 / INPUT_GRID)).round_().mul_(INPUT_GRID).clamp_(-INPUT_LIMIT, INPUT_LIMIT)


class Linear(nn.Linear):
    """A linear layer whose input is snapped in float64."""

    def forward(self, input: Tensor) -> Tensor:
        """(..., out) from (..., in)."""
        return super().forward(snapped(input))


class Scaler(nn.Module):
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
        layers.append(Linear(inner, outer))
    return nn.Sequential(*layers)


def make_exact(net: nn.Module) -> float:
    """Turn a trained network into the one that runs: float64, weights on their grid, nothing to train.

    Returns:
        The largest sum of |weight| of an output over `WEIGHT_SUM_LIMIT`; products are exact below 1.
    """
    net.double().eval().requires_grad_(False)
    largest = 0.0
    for parameter in net.parameters():
        parameter.copy_((parameter / WEIGHT_GRID).round() * WEIGHT_GRID)
        if parameter.dim() >= 2:
            largest = max(largest, float(parameter.abs().flatten(1).sum(1).max()))
    return largest / WEIGHT_SUM_LIMIT
