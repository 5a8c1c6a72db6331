"""The loss, part by part, from numbers one can add up."""

from __future__ import annotations

import math

import pytest

torch = pytest.importorskip("torch")

from scex_sumo.learned.training.data.batches import Batch  # noqa: E402
from scex_sumo.learned.training.loss import LossWeights, loss  # noqa: E402
from scex_sumo.learned.training.networks.graph import ModeTensors, PathBatch, SceneBatch  # noqa: E402

H = 30


def _batch(node: list[int], right: list[bool], s: float = 30.0, speed: float = 10.0) -> Batch:
    n = len(node)
    empty = torch.zeros(0)
    share = torch.tensor(right).float()
    time = torch.arange(1, H + 1) / H
    return Batch(
        scene=SceneBatch(empty, empty, empty, empty),
        path=PathBatch(torch.tensor(node), torch.zeros(n, 1)),
        right=torch.tensor(right),
        share=share,
        site=torch.zeros(n, dtype=torch.int64),
        pose=torch.zeros(n, 3, dtype=torch.float64),
        s=(s * time).expand(n, H),
        d=torch.zeros(n, H),
        start=torch.tensor([[speed, 0.0, 0.0, 0.0]]).expand(n, 4),
        xy=torch.stack([s * time, 0 * time], -1).expand(n, H, 2),
    )


def _modes(acceleration: list[float], n: int = 1, logits: list[float] | None = None) -> ModeTensors:
    a = torch.tensor(acceleration)[None, :, None].expand(n, len(acceleration), H).clone()
    given = torch.zeros(n, len(acceleration)) if logits is None else torch.tensor([logits] * n)
    return ModeTensors(given, a, torch.zeros_like(a), torch.zeros(n), None)


def test_nothing_is_lost_on_the_recorded_track() -> None:
    modes, batch = _modes([0.0] * 6), _batch([0], [True])
    _, parts = loss(modes, batch, LossWeights())
    assert parts["expected"] == pytest.approx(0.0, abs=1e-5)
    assert parts["winner"] == pytest.approx(0.0, abs=1e-5)
    assert parts["path"] == pytest.approx(0.0, abs=1e-5)
    assert parts["smooth"] == pytest.approx(0.0, abs=1e-6)


def test_two_right_paths_of_three_share_their_probability() -> None:
    batch = _batch([0, 0, 0], [True, True, False])
    _, parts = loss(_modes([0.0], n=3), batch, LossWeights(path=1.0))
    assert parts["path"] == pytest.approx(math.log(3 / 2), abs=1e-5)


def test_hard_braking_costs_and_soft_braking_does_not() -> None:
    batch = _batch([0], [True])
    weights = LossWeights(acceleration=1.0, jerk=0.0, hard=3.0)
    assert loss(_modes([-5.0]), batch, weights)[1]["smooth"] == pytest.approx(4.0)  # (5 - 3)²
    assert loss(_modes([-2.9]), batch, weights)[1]["smooth"] == pytest.approx(0.0)
