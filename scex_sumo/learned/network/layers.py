"""Layers of the networks, with exact sums that make results independent of the batch.

Float sums depend on their order, which libraries change with the number of rows. So weights and inputs are
rounded to multiples of powers of two: every partial sum fits into a float64.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scex_sumo.base.arrays import FloatArray
from scex_sumo.learned.network.architecture import SCALED_LIMIT

INPUT_GRID = 2.0**-14
WEIGHT_GRID = 2.0**-20
INPUT_LIMIT = 2.0**8
# Sum of |weight| per output up to which every partial sum is exact: 2^53 grid steps of the products.
WEIGHT_SUM_LIMIT = 2.0**53 * INPUT_GRID * WEIGHT_GRID / INPUT_LIMIT
_TO_GRID = 1.5 * 2.0**52 * INPUT_GRID  # its last bit is a grid step, so that adding it rounds
_EPSILON = 1e-5  # of normalisation

State: TypeAlias = Mapping[str, NDArray[Any]]
"""Arrays of a network by name."""


def exact(state: State) -> tuple[State, float]:
    """Convert a trained network's arrays to float64, with weights on their grid.

    Returns:
        The arrays, and the largest sum of |weight| of an output over `WEIGHT_SUM_LIMIT`; sums are exact
        below 1.
    """
    tensors, largest = {}, 0.0
    for name, trained in state.items():
        values = trained.astype(np.float64)
        if not name.endswith((".mean", ".spread")):
            values = np.round(values / WEIGHT_GRID) * WEIGHT_GRID
            if values.ndim >= 2:
                largest = max(largest, float(np.abs(values).reshape(len(values), -1).sum(1).max()))
        tensors[name] = values
    return tensors, largest / WEIGHT_SUM_LIMIT


def snapped(values: FloatArray) -> FloatArray:
    """Round values to the grid on which products are exact."""
    within: FloatArray = np.clip(values, -INPUT_LIMIT, INPUT_LIMIT)
    within += _TO_GRID
    within -= _TO_GRID
    return within


def relu(values: FloatArray) -> FloatArray:
    """Replace negative values by 0, in place."""
    return np.maximum(values, 0.0, out=values)


class Linear:
    """Linear layer with a snapped input."""

    def __init__(self, state: State, name: str) -> None:
        self.weight = np.ascontiguousarray(state[f"{name}.weight"].T)
        self.bias = state.get(f"{name}.bias")

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return (n, out) of (n, in)."""
        output: FloatArray = snapped(values) @ self.weight
        if self.bias is not None:
            output += self.bias
        return output


class Mlp:
    """Two linear layers with ReLU between them."""

    def __init__(self, state: State, name: str) -> None:
        self.first, self.second = Linear(state, f"{name}.0"), Linear(state, f"{name}.2")

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return (n, out) of (n, in)."""
        return self.second(relu(self.first(values)))


class Scaler:
    """Scaling of raw inputs to about zero mean and unit spread, bounded."""

    def __init__(self, state: State, name: str) -> None:
        self.mean, self.spread = state[f"{name}.mean"], state[f"{name}.spread"]

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return (n, columns) scaled."""
        scaled = values - self.mean
        scaled /= self.spread
        return np.clip(scaled, -SCALED_LIMIT, SCALED_LIMIT, out=scaled)


class Norm:
    """Normalisation of each row to mean 0 and variance 1, then weights and bias."""

    def __init__(self, state: State, name: str) -> None:
        self.weight, self.bias = state[f"{name}.weight"], state[f"{name}.bias"]

    def __call__(self, values: FloatArray) -> FloatArray:
        """Return (n, columns) normalised."""
        off: FloatArray = values - values.mean(axis=1, keepdims=True)
        off /= np.sqrt(np.square(off).mean(axis=1, keepdims=True) + _EPSILON)
        off *= self.weight
        off += self.bias
        return off
