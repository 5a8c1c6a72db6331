"""Networks in training: graph branch, head, and the Graph Predictor."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor, nn

from scex_sumo.behaviors.learned.architecture import (
    HISTORY_NUMBERS,
    KNOTS,
    OFFSET,
    PRESENT,
    SPEED,
    STRONGEST_ACCELERATION,
    STRONGEST_BRAKING,
    WIDEST_OFFSET_M,
    Architecture,
)
from scex_sumo.behaviors.learned.networks import interpolation
from scex_sumo.scene import STEP_S
from scex_sumo.training.networks.layers import EdgeAttentionModule, ScalerModule, mlp


class SceneBatch(NamedTuple):
    """Scene graphs of a batch as tensors, see `SceneGraph`."""

    node: Tensor
    history: Tensor
    edge_index: Tensor
    edge: Tensor


class PathBatch(NamedTuple):
    """Pairs of a vehicle and a path as tensors, see `PathInputs`."""

    node: Tensor
    features: Tensor


class ModeTensors(NamedTuple):
    """Modes of n pairs as tensors, see `scex_sumo.behaviors.learned.networks.Modes`."""

    logits: Tensor
    acceleration: Tensor
    offset: Tensor | None
    path_logit: Tensor
    free: Tensor | None


class SceneModule(nn.Module):
    """Vectors of vehicles, as `SceneEncoder`."""

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.node_scale, self.edge_scale = ScalerModule(sizes.node_columns), ScalerModule(sizes.edge_columns)
        self.history_scale = ScalerModule(HISTORY_NUMBERS)
        self.embed = mlp(sizes.node_columns + HISTORY_NUMBERS, 2 * sizes.hidden, sizes.hidden)
        layers = sizes.attention_layers
        each = sizes.hidden // sizes.heads
        self.attend = nn.ModuleList(
            EdgeAttentionModule(sizes.hidden, each, heads=sizes.heads, edge_columns=sizes.edge_columns)
            for _ in range(layers)
        )
        self.norm = nn.ModuleList(nn.LayerNorm(sizes.hidden) for _ in range(layers + 1))

    def forward(self, scene: SceneBatch, wanted: Tensor) -> Tensor:
        """Return (n, hidden) of (n,) wanted nodes; nodes that do not reach them are left out."""
        needed = torch.zeros(len(scene.node), dtype=torch.bool, device=wanted.device)
        needed[wanted] = True
        reach = [needed]
        for _ in self.attend:
            source = scene.edge_index[0, needed[scene.edge_index[1]]]
            needed = needed.index_fill(0, source, True)
            reach.insert(0, needed)
        history = self.history_scale(scene.history[needed].flatten(1))
        h: Tensor = self.norm[0](self.embed(torch.cat([self.node_scale(scene.node[needed]), history], 1)))
        edges, edge = scene.edge_index, scene.edge
        for layer, (attend, norm) in enumerate(zip(self.attend, list(self.norm)[1:], strict=True)):
            needed, asking = reach[layer : layer + 2]
            some = torch.nonzero(asking[edges[1]])[:, 0]
            edges, edge = edges[:, some], edge.index_select(0, some)
            edge = edge if layer else self.edge_scale(edge)
            kept = asking[needed]
            index = torch.stack([_numbers(needed)[edges[0]], _numbers(asking)[edges[1]]])
            h = norm(h[kept] + torch.relu(attend(h, index, edge, h[kept])))
        return h[_numbers(reach[-1])[wanted]]


def _numbers(some: Tensor) -> Tensor:
    """Return (N,) numbers of nodes among those for which (N,) ``some`` is true."""
    return torch.cumsum(some, 0) - 1


class PlanHeadModule(nn.Module):
    """Modes from one vector per pair, as `PlanHead`."""

    between: Tensor

    def __init__(self, sizes: Architecture, inner: int, *, steers: bool) -> None:
        super().__init__()
        self.modes, self.steers, self.free = sizes.modes, steers, steers and sizes.free
        per_mode = KNOTS + (KNOTS - 1 if steers else 0) + (2 * KNOTS if self.free else 0)
        self.body = mlp(inner, 2 * sizes.hidden, 2 * sizes.hidden)
        self.knots = nn.Linear(2 * sizes.hidden, sizes.modes * per_mode)
        self.choice = nn.Linear(2 * sizes.hidden, sizes.modes + 1 + len(PRESENT))
        self.register_buffer("between", torch.from_numpy(interpolation()), persistent=False)

    def forward(self, h: Tensor, features: Tensor) -> ModeTensors:
        """Return modes of (n, inner) vectors and the raw `features` of the pairs."""
        h = torch.relu(self.body(h))
        choice = self.choice(h)
        knots = self.knots(h).unflatten(1, (self.modes, -1))
        offset = free = None
        if self.steers:
            offset = self._offset(knots[..., KNOTS : 2 * KNOTS - 1], features[:, OFFSET])
        if self.free:
            free = self._free(knots[..., 2 * KNOTS - 1 :].unflatten(2, (KNOTS, 2)), features[:, SPEED])
        logits, path, trust = choice.split([self.modes, 1, len(PRESENT)], 1)
        present = (torch.sigmoid(trust) * features[:, PRESENT].clamp(-4.0, 4.0)).sum(1)
        acceleration = self._acceleration(knots[..., :KNOTS], present)
        return ModeTensors(logits, acceleration, offset, path[:, 0], free)

    def _acceleration(self, knots: Tensor, present: Tensor) -> Tensor:
        fading = torch.exp(-torch.arange(KNOTS, dtype=knots.dtype, device=knots.device))
        wanted = knots + present[:, None, None] * fading
        bounded = torch.where(
            wanted > 0,
            STRONGEST_ACCELERATION * torch.tanh(wanted / STRONGEST_ACCELERATION),
            STRONGEST_BRAKING * torch.tanh(wanted / STRONGEST_BRAKING),
        )
        return bounded @ self.between

    def _offset(self, knots: Tensor, present: Tensor) -> Tensor:
        change = WIDEST_OFFSET_M * torch.tanh(knots / WIDEST_OFFSET_M)
        change = torch.cat([torch.zeros_like(change[..., :1]), change], 2)
        return change @ self.between + present[:, None, None]

    def _free(self, knots: Tensor, speed: Tensor) -> Tensor:
        velocity = torch.einsum("nmkc,kh->nmhc", knots, self.between)
        ahead = velocity[..., 0] + speed[:, None, None]
        return torch.cumsum(torch.stack([ahead, velocity[..., 1]], -1), 2) * STEP_S


class GraphPredictorNet(nn.Module):
    """Network of the Graph Predictor, as `GraphNet`."""

    kind = "graph"

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.sizes = sizes
        self.scene = SceneModule(sizes)
        self.path_scale = ScalerModule(sizes.path_columns)
        self.path = mlp(sizes.path_columns, 2 * sizes.hidden, sizes.hidden)
        self.head = PlanHeadModule(replace(sizes, free=False), 2 * sizes.hidden, steers=True)

    def forward(self, scene: SceneBatch, path: PathBatch) -> ModeTensors:
        """Return modes of n pairs."""
        way = torch.relu(self.path(self.path_scale(path.features)))
        h = torch.cat([self.scene(scene, path.node), way], 1)
        modes: ModeTensors = self.head(h, path.features)
        return modes
