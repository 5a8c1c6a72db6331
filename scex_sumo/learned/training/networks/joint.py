"""Network of the joint predictor, as `scex_sumo.learned.network.networks.JointNet`, with its loss."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from scipy.cluster.vq import kmeans2
from torch import Tensor, nn
from torch.nn.functional import log_softmax

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.learned.network.architecture import Architecture
from scex_sumo.learned.training.networks.graph import (
    ModeTensors,
    PathBatch,
    PlanHeadModule,
    ScalerModule,
    SceneBatch,
    SceneModule,
    mlp,
)
from scex_sumo.scene import STEP_S

LABEL_STEPS = 15  # of the recorded way that gives a motion
ROUNDS = 30  # of k-means


class TokenTensors(NamedTuple):
    """Tokens of n pairs as tensors, see `scex_sumo.learned.network.networks.Tokens`.

    Attributes:
        whole: plans of 3 s, from which the layers below learn, too.
    """

    logits: Tensor
    path_logit: Tensor
    acceleration: Tensor
    sideways: Tensor
    whole: ModeTensors


class JointHead(nn.Module):
    """Logits of all classes of motion, and of the path."""

    acceleration: Tensor
    sideways: Tensor

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        double = 2 * sizes.hidden
        self.body = mlp(double, double, double)
        self.choice = nn.Linear(double, sizes.accelerations * sizes.sideways + 1)
        self.register_buffer("acceleration", torch.zeros(sizes.accelerations))
        self.register_buffer("sideways", torch.zeros(sizes.sideways))

    def forward(self, h: Tensor, whole: ModeTensors) -> TokenTensors:
        """Return tokens of (n, inner) vectors."""
        choice = self.choice(torch.relu(self.body(h)))
        return TokenTensors(choice[:, :-1], choice[:, -1], self.acceleration, self.sideways, whole)


class JointPredictorNet(nn.Module):
    """Network from scene graph, history and path ahead to the motion of the next 0.5 s.

    A second head, with plans of 3 s, is for training alone.
    """

    kind = "joint"

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.sizes = replace(sizes, free=False)
        self.scene, self.path_scale = SceneModule(sizes), ScalerModule(sizes.path_columns)
        self.path = mlp(sizes.path_columns, 2 * sizes.hidden, sizes.hidden)
        self.head = JointHead(sizes)
        self.whole = PlanHeadModule(self.sizes)

    def forward(self, scene: SceneBatch, path: PathBatch) -> TokenTensors:
        """Return tokens of n pairs."""
        way = torch.relu(self.path(self.path_scale(path.features)))
        h = torch.cat([self.scene(scene, path.node), way], 1)
        tokens: TokenTensors = self.head(h, self.whole(h, path.features))
        return tokens

    def fit_tokens(self, s: FloatArray, d: FloatArray, start: FloatArray) -> None:
        """Cluster recorded motions into the classes; arguments as in `motions`."""
        along, aside = motions(*(torch.as_tensor(values) for values in (s, d, start)))
        for buffer, values in ((self.head.acceleration, along), (self.head.sideways, aside)):
            buffer.copy_(torch.as_tensor(_clusters(values.numpy().astype(np.float64), len(buffer))))


def motions(s: Tensor, d: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
    """Return (n,) accelerations, m/s², and (n,) sideways speeds, m/s, of targets as in `TrainingSamples`."""
    t = STEP_S * LABEL_STEPS
    speed = start[:, 0].clamp(min=0.0)
    acceleration = 2 * (s[:, LABEL_STEPS - 1] - speed * t) / t**2
    sideways = (d[:, LABEL_STEPS - 1] - start[:, 1]) / t
    return acceleration, sideways


def _clusters(values: FloatArray, count: int) -> FloatArray:
    low, high = np.quantile(values, [0.0005, 0.9995])
    values = np.clip(values, low, high)
    # Between quantiles, which are dense around 0, and an even grid, which reaches rare motions.
    even = (np.arange(count) + 0.5) / count
    centres = (np.quantile(values, even) + low + (high - low) * even) / 2
    centres, _ = kmeans2(values[:, None], centres[:, None], iter=ROUNDS, minit="matrix")
    return np.asarray(np.sort(centres[:, 0]))


def token_errors(tokens: TokenTensors, s: Tensor, d: Tensor, start: Tensor) -> Tensor:
    """Return (n,) negative log probabilities of the recorded motions."""
    along, aside = motions(s, d, start)
    a = (along[:, None] - tokens.acceleration).abs().argmin(1)
    wanted = a * len(tokens.sideways) + (aside[:, None] - tokens.sideways).abs().argmin(1)
    return -log_softmax(tokens.logits, 1).gather(1, wanted[:, None])[:, 0]


def likely_modes(tokens: TokenTensors, offset: Tensor, guesses: int) -> ModeTensors:
    """Return the expected motion and the likeliest ones, each kept for 3 s, from (n,) offsets in m."""
    likely = torch.softmax(tokens.logits, 1).view(-1, len(tokens.acceleration), len(tokens.sideways))
    logits, best = tokens.logits.topk(guesses, 1)
    along, aside = tokens.acceleration[best // likely.shape[2]], tokens.sideways[best % likely.shape[2]]
    expected = likely.sum(2) @ tokens.acceleration, likely.sum(1) @ tokens.sideways
    along, aside = torch.cat([expected[0][:, None], along], 1), torch.cat([expected[1][:, None], aside], 1)
    time = STEP_S * torch.arange(1, PLAN_STEPS + 1, device=along.device)
    return ModeTensors(
        torch.cat([torch.full_like(logits[:, :1], -torch.inf), logits], 1),
        along[..., None].expand(-1, -1, PLAN_STEPS),
        offset[:, None, None] + aside[..., None] * time,
        tokens.path_logit,
        None,
    )
