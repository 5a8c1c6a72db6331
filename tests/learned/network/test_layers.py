"""Arithmetic that does not depend on the order of sums."""

from __future__ import annotations

import numpy as np

from scex_sumo.learned.network.layers import INPUT_GRID, INPUT_LIMIT, WEIGHT_GRID, Linear, exact, snapped

RNG = np.random.default_rng(0)


def test_values_are_rounded_to_the_grid_halves_to_even_and_bounded() -> None:
    steps = np.array([0.4, 0.6, -1.5, 0.5, 2.5, 1e9, -1e9])
    on_grid = snapped(steps * INPUT_GRID)
    assert (on_grid / INPUT_GRID).tolist() == [0, 1, -2, 0, 2, 2**22, -(2**22)]
    assert on_grid[5] == INPUT_LIMIT
    values = RNG.normal(0, 50, 10_000)
    assert np.array_equal(snapped(values), np.round(values / INPUT_GRID) * INPUT_GRID)


def test_a_linear_layer_gives_the_same_bytes_whatever_the_order_of_its_sums() -> None:
    state, _ = exact(
        {"a.weight": RNG.uniform(-0.05, 0.05, (40, 500)), "a.bias": RNG.uniform(-0.05, 0.05, 40)}
    )
    layer = Linear(state, "a")
    x = RNG.normal(size=(64, 500))
    whole = layer(x)
    plain = x @ (layer.weight + 1e-9)
    different = 0
    for k in range(20):
        order = np.random.default_rng(k).permutation(500)
        assert np.array_equal(snapped(x[:, order]) @ layer.weight[order] + layer.bias, whole)
        different += int((x[:, order] @ (layer.weight[order] + 1e-9) != plain).sum())
    assert different > 0  # so it would not without the grid
    for rows in (1, 3, 17):
        parts = np.split(x, range(rows, 64, rows))
        assert np.array_equal(np.concatenate([layer(part) for part in parts]), whole)


def test_making_exact_rounds_weights_and_says_how_near_the_limit_they_are() -> None:
    trained = {"a.weight": RNG.normal(size=(2, 3)), "a.bias": RNG.normal(size=2), "s.mean": np.array([0.1])}
    state, share = exact(trained)
    for name in ("a.weight", "a.bias"):
        assert np.array_equal(np.round(state[name] / WEIGHT_GRID) * WEIGHT_GRID, state[name])
        assert np.abs(state[name] - trained[name]).max() <= WEIGHT_GRID / 2
    assert state["s.mean"] == trained["s.mean"]  # no product
    assert share == np.abs(state["a.weight"]).sum(1).max() / 2**11
    assert exact({"a.weight": np.full((1, 3), 1000.0)})[1] > 1
