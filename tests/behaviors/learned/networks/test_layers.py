"""Arithmetic that does not depend on the order of sums."""

from __future__ import annotations

import numpy as np
import torch

from scex_sumo.behaviors.learned.networks.layers import (
    INPUT_GRID,
    INPUT_LIMIT,
    WEIGHT_GRID,
    Linear,
    Scaler,
    make_exact,
    mlp,
    snapped,
)


def test_values_are_rounded_to_the_grid_in_float64_only() -> None:
    values = torch.tensor([0.4, 0.6, -1.5, 1e9], dtype=torch.float64) * INPUT_GRID
    assert torch.equal(snapped(values) / INPUT_GRID, torch.tensor([0.0, 1.0, -2.0, 2**22]).double())
    assert snapped(values)[3] == INPUT_LIMIT
    assert torch.equal(snapped(values.float()), values.float())


def test_a_linear_layer_gives_the_same_bytes_whatever_the_order_of_its_sums() -> None:
    torch.manual_seed(0)
    layer = Linear(500, 40)
    make_exact(layer)
    x = torch.randn(64, 500, dtype=torch.float64)
    whole = layer(x)
    plain = torch.nn.functional.linear(x, layer.weight + 1e-9, layer.bias)
    different = 0
    for k in range(20):
        order = torch.from_numpy(np.random.default_rng(k).permutation(500))
        shuffled = torch.nn.functional.linear(snapped(x[:, order]), layer.weight[:, order], layer.bias)
        assert torch.equal(shuffled, whole)
        rough = torch.nn.functional.linear(x[:, order], layer.weight[:, order] + 1e-9, layer.bias)
        different += int((rough != plain).sum())
    assert different > 0  # so it would not without the grid
    for rows in (1, 3, 17):
        assert torch.equal(torch.cat([layer(part) for part in x.split(rows)]), whole)


def test_making_exact_rounds_weights_and_says_how_near_the_limit_they_are() -> None:
    net = mlp(3, 2, 1)
    share = make_exact(net)
    weights = [p for p in net.parameters() if p.dim() == 2]
    assert all(p.dtype == torch.float64 and not p.requires_grad for p in net.parameters())
    assert all(torch.equal((p / WEIGHT_GRID).round() * WEIGHT_GRID, p) for p in weights)
    assert share == max(float(p.abs().sum(1).max()) for p in weights) / 2**11
    weights[0].fill_(1000.0)
    assert make_exact(net) > 1


def test_scaling_has_mean_zero_spread_one_and_bounds() -> None:
    scale = Scaler(2)
    values = torch.tensor([[1.0, 5.0], [3.0, 5.0], [5.0, 5.0]])
    scale.fit(values)
    assert torch.equal(scale(values), torch.tensor([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]))
    assert torch.equal(scale(torch.tensor([[1e9, -1e9]])), torch.tensor([[10.0, -10.0]]))
