"""Networks in training: graph branch, heads, the Graph Predictor and the joint predictor with its loss."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from scipy.cluster.vq import kmeans2
from torch import Tensor, nn
from torch.nn.functional import log_softmax

from scex_sumo.base.arrays import FloatArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.learned.network.architecture import (
    HISTORY_NUMBERS,
    KNOTS,
    OFFSET,
    PRESENT,
    SCALED_LIMIT,
    SLOPE,
    SPEED,
    STRONGEST_ACCELERATION,
    STRONGEST_BRAKING,
    WIDEST_OFFSET_M,
    Architecture,
)
from scex_sumo.learned.network.networks import interpolation
from scex_sumo.scene import STEP_S

LABEL_STEPS = 15  # of the recorded way that gives a motion
ROUNDS = 30  # of k-means


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
    """Modes of n pairs as tensors, see `scex_sumo.learned.network.networks.Modes`."""

    logits: Tensor
    acceleration: Tensor
    offset: Tensor
    path_logit: Tensor
    free: Tensor | None


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

    def __init__(self, inner: int, per_head: int, *, heads: int, edge_columns: int) -> None:
        super().__init__()
        self.lin_l = nn.Linear(inner, heads * per_head)
        self.lin_r = nn.Linear(inner, heads * per_head)
        self.lin_edge = nn.Linear(edge_columns, heads * per_head, bias=False)
        self.att = nn.Parameter(torch.empty(1, heads, per_head))
        self.bias = nn.Parameter(torch.zeros(heads * per_head))
        for layer in (self.lin_l, self.lin_r, self.lin_edge):
            _draw(layer.weight)
            if layer.bias is not None:
                nn.init.uniform_(layer.bias, -1 / math.sqrt(inner), 1 / math.sqrt(inner))
        _draw(self.att)

    def forward(self, node: Tensor, edge_index: Tensor, edge: Tensor, asking: Tensor) -> Tensor:
        """Return (K, heads * per_head) of ``asking`` (K, inner), among which the targets of the edges are."""
        heads, per_head = self.att.shape[1:]
        source, target = edge_index
        key = self.lin_l(node).view(-1, heads, per_head).index_select(0, source)
        query = self.lin_r(asking).view(-1, heads, per_head).index_select(0, target)
        mixed = query + key + self.lin_edge(edge).view(-1, heads, per_head)
        score = (nn.functional.leaky_relu(mixed, SLOPE) * self.att).sum(dim=-1)
        weight = _softmax(score, target, len(asking))
        taken = _sum(key * weight.unsqueeze(-1), target, len(asking))
        out: Tensor = taken.view(-1, heads * per_head) + self.bias
        return out


def _draw(weight: Tensor) -> None:
    bound = math.sqrt(6.0 / (weight.size(-2) + weight.size(-1)))
    nn.init.uniform_(weight, -bound, bound)


def _softmax(score: Tensor, target: Tensor, nodes: int) -> Tensor:
    index = target.view(-1, 1).expand_as(score)
    largest = score.new_zeros(nodes, score.shape[1])
    largest = largest.scatter_reduce(0, index, score.detach(), "amax", include_self=False)
    raised = (score - largest.index_select(0, target)).exp()
    total = _sum(raised, target, nodes) + 1e-16
    return raised / total.index_select(0, target)


def _sum(values: Tensor, target: Tensor, nodes: int) -> Tensor:
    index = target.view(-1, *[1] * (values.dim() - 1)).expand_as(values)
    return values.new_zeros(nodes, *values.shape[1:]).scatter_add(0, index, values)


class SceneModule(nn.Module):
    """Vectors of vehicles, as `SceneEncoder`."""

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.node_scale, self.edge_scale = ScalerModule(sizes.node_columns), ScalerModule(sizes.edge_columns)
        self.history_scale = ScalerModule(HISTORY_NUMBERS)
        self.embed = mlp(sizes.node_columns + HISTORY_NUMBERS, 2 * sizes.hidden, sizes.hidden)
        layers = sizes.attention_layers
        per_head = sizes.hidden // sizes.heads
        self.attend = nn.ModuleList(
            EdgeAttentionModule(sizes.hidden, per_head, heads=sizes.heads, edge_columns=sizes.edge_columns)
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
            used = torch.nonzero(asking[edges[1]])[:, 0]
            edges, edge = edges[:, used], edge.index_select(0, used)
            edge = edge if layer else self.edge_scale(edge)
            kept = asking[needed]
            index = torch.stack([_numbers(needed)[edges[0]], _numbers(asking)[edges[1]]])
            h = norm(h[kept] + torch.relu(attend(h, index, edge, h[kept])))
        return h[_numbers(reach[-1])[wanted]]


def _numbers(mask: Tensor) -> Tensor:
    return torch.cumsum(mask, 0) - 1


class PlanHeadModule(nn.Module):
    """Modes from one vector per pair, as `PlanHead`."""

    between: Tensor

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.modes, self.free = sizes.modes, sizes.free
        per_mode = 2 * KNOTS - 1 + (2 * KNOTS if self.free else 0)
        self.body = mlp(2 * sizes.hidden, 2 * sizes.hidden, 2 * sizes.hidden)
        self.knots = nn.Linear(2 * sizes.hidden, sizes.modes * per_mode)
        self.choice = nn.Linear(2 * sizes.hidden, sizes.modes + 1 + len(PRESENT))
        self.register_buffer("between", torch.from_numpy(interpolation()), persistent=False)

    def forward(self, h: Tensor, features: Tensor) -> ModeTensors:
        """Return modes of (n, inner) vectors and the raw `features` of the pairs."""
        h = torch.relu(self.body(h))
        choice = self.choice(h)
        knots = self.knots(h).unflatten(1, (self.modes, -1))
        offset = self._offset(knots[..., KNOTS : 2 * KNOTS - 1], features[:, OFFSET])
        free = None
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


class PairModule(nn.Module):
    """Vectors of pairs of a vehicle and a path, which both networks without an image begin with."""

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.sizes = replace(sizes, free=False)
        self.scene, self.path_scale = SceneModule(sizes), ScalerModule(sizes.path_columns)
        self.path = mlp(sizes.path_columns, 2 * sizes.hidden, sizes.hidden)

    def pairs(self, scene: SceneBatch, path: PathBatch) -> Tensor:
        """Return (n, inner) of n pairs."""
        encoded = torch.relu(self.path(self.path_scale(path.features)))
        return torch.cat([self.scene(scene, path.node), encoded], 1)


class GraphPredictorNet(PairModule):
    """Network of the Graph Predictor, as `GraphNet`."""

    kind = "graph"

    def __init__(self, sizes: Architecture) -> None:
        super().__init__(sizes)
        self.head = PlanHeadModule(self.sizes)

    def forward(self, scene: SceneBatch, path: PathBatch) -> ModeTensors:
        """Return modes of n pairs."""
        modes: ModeTensors = self.head(self.pairs(scene, path), path.features)
        return modes


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


class JointPredictorNet(PairModule):
    """Network from scene graph, history and path ahead to the motion of the next 0.5 s.

    A second head, with plans of 3 s, is for training alone.
    """

    kind = "joint"

    def __init__(self, sizes: Architecture) -> None:
        super().__init__(sizes)
        self.head = JointHead(sizes)
        self.whole = PlanHeadModule(self.sizes)

    def forward(self, scene: SceneBatch, path: PathBatch) -> TokenTensors:
        """Return tokens of n pairs."""
        h = self.pairs(scene, path)
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


def expected_mode(tokens: TokenTensors, offset: Tensor) -> ModeTensors:
    """Return the expected motion, kept for 3 s, as the only mode, from (n,) offsets in m."""
    likely = torch.softmax(tokens.logits, 1).view(-1, len(tokens.acceleration), len(tokens.sideways))
    along, aside = likely.sum(2) @ tokens.acceleration, likely.sum(1) @ tokens.sideways
    time = STEP_S * torch.arange(1, PLAN_STEPS + 1, device=along.device)
    acceleration, beside = along[:, None].expand(-1, PLAN_STEPS), offset[:, None] + aside[:, None] * time
    return ModeTensors(
        torch.zeros_like(along[:, None]), acceleration[:, None], beside[:, None], tokens.path_logit, None
    )
