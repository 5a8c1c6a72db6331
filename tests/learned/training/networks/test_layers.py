"""Building blocks of the networks in training."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from scex_sumo.learned.training.networks.graph import ScalerModule  # noqa: E402


def test_scaling_has_mean_zero_spread_one_and_bounds() -> None:
    scale = ScalerModule(2)
    values = torch.tensor([[1.0, 5.0], [3.0, 5.0], [5.0, 5.0]])
    scale.fit(values)
    assert torch.equal(scale(values), torch.tensor([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]))
    assert torch.equal(scale(torch.tensor([[1e9, -1e9]])), torch.tensor([[10.0, -10.0]]))
