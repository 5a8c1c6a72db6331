"""The networks of the learned drivers: graph branch, heads, and what they predict."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor, nn

from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.behaviors.learned.networks.attention import EdgeAttention
from scex_sumo.behaviors.learned.networks.layers import Linear, Scaler, mlp, snapped
from scex_sumo.behaviors.learned.seen.inputs import OWN_COLUMNS, PATH_COLUMNS
from scex_sumo.records import dataclass
from scex_sumo.scene import HISTORY_STEPS, STEP_S

KNOT_S = 0.5
KNOTS = round(PLAN_STEPS * STEP_S / KNOT_S) + 1
STRONGEST_BRAKING = 9.0  # m/s²
STRONGEST_ACCELERATION = 5.0
WIDEST_OFFSET_M = 8.0  # from the present offset
HISTORY_COLUMNS = 5
SPEED, OFFSET = OWN_COLUMNS.index("speed"), OWN_COLUMNS.index("offset")
PRESENT = tuple(OWN_COLUMNS.index(name) for name in ("acceleration", "trend"))  # of the last 0.3 s and 1 s


class SceneBatch(NamedTuple):
    """Scene graphs of a batch as tensors, see `SceneGraph`: N nodes, E edges.

    Attributes:
        node: (N, F).
        history: (N, 11, 5).
        edge_index: (2, E) source, target.
        edge: (E, G).
    """

    node: Tensor
    history: Tensor
    edge_index: Tensor
    edge: Tensor


class PathBatch(NamedTuple):
    """Pairs of a vehicle and a path, see `PathInputs`.

    Attributes:
        node: (n,) row of the scene batch.
        features: (n, P) raw.
    """

    node: Tensor
    features: Tensor


class Modes(NamedTuple):
    """What may happen in the next 3 s along each path, in M modes; mode 0 is the expected one.

    Attributes:
        logits: (n, M) of the modes.
        acceleration: (n, M, H) m/s², between -9 and 5.
        offset: (n, M, H) wanted distance left of the path, m; None without that head.
        path_logit: (n,) of the path among the candidates of its vehicle.
        free: (n, M, H, 2) x ahead and y to the left of the present pose, m; None without that head.
    """

    logits: Tensor
    acceleration: Tensor
    offset: Tensor | None
    path_logit: Tensor
    free: Tensor | None


@dataclass(frozen=True, kw_only=True)
class Architecture:
    """Numbers from which a network is built; kept with its weights.

    Attributes:
        node_columns: F.
        edge_columns: G.
        path_columns: P.
        hidden: width of all embeddings.
        layers: attention layers on the graph.
        heads: attention heads.
        modes: M.
        edges: False is for comparison: vehicles do not see each other through the graph.
        free: the network also has the head for free trajectories (hybrid only).
    """

    node_columns: int
    edge_columns: int
    path_columns: int = len(PATH_COLUMNS)
    hidden: int = 64
    layers: int = 2
    heads: int = 4
    modes: int = 6
    edges: bool = True
    free: bool = True


class SceneEncoder(nn.Module):
    """Vehicles as vectors: each one's history and properties, then attention along the scene graph."""

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.node_scale, self.edge_scale = Scaler(sizes.node_columns), Scaler(sizes.edge_columns)
        self.history_scale = Scaler((HISTORY_STEPS + 1) * HISTORY_COLUMNS)
        inner = sizes.node_columns + (HISTORY_STEPS + 1) * HISTORY_COLUMNS
        self.embed = mlp(inner, 2 * sizes.hidden, sizes.hidden)
        layers = sizes.layers if sizes.edges else 0
        each = sizes.hidden // sizes.heads
        self.attend = nn.ModuleList(
            EdgeAttention(sizes.hidden, each, heads=sizes.heads, edge_columns=sizes.edge_columns)
            for _ in range(layers)
        )
        self.norm = nn.ModuleList(nn.LayerNorm(sizes.hidden) for _ in range(layers + 1))

    def forward(self, scene: SceneBatch, wanted: Tensor) -> Tensor:
        """(n, hidden) of (n,) wanted nodes; what does not reach them through the layers is left out."""
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
            edge = edge if layer else snapped(self.edge_scale(edge))
            seen, kept = snapped(h), asking[needed]
            index = torch.stack([_numbers(needed)[edges[0]], _numbers(asking)[edges[1]]])
            h = norm(h[kept] + torch.relu(attend(seen, index, edge, seen[kept])))
        return h[_numbers(reach[-1])[wanted]]


def _numbers(some: Tensor) -> Tensor:
    """(N,) number of each node among some, which are given as (N,) whether it is one."""
    return torch.cumsum(some, 0) - 1


class PlanHead(nn.Module):
    """From one vector per pair to modes: knots every 0.5 s, linear between."""

    between: Tensor

    def __init__(self, sizes: Architecture, inner: int, *, steers: bool) -> None:
        super().__init__()
        self.modes, self.steers, self.free = sizes.modes, steers, steers and sizes.free
        per_mode = KNOTS + (KNOTS - 1 if steers else 0) + (2 * KNOTS if self.free else 0)
        self.body = mlp(inner, 2 * sizes.hidden, 2 * sizes.hidden)
        self.knots = Linear(2 * sizes.hidden, sizes.modes * per_mode)
        self.choice = Linear(2 * sizes.hidden, sizes.modes + 1 + len(PRESENT))
        self.register_buffer("between", interpolation(), persistent=False)

    def forward(self, h: Tensor, features: Tensor) -> Modes:
        """Modes of (n, inner) vectors; `features` are the raw ones of the pairs."""
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
        return Modes(logits, acceleration, offset, path[:, 0], free)

    def _acceleration(self, knots: Tensor, present: Tensor) -> Tensor:
        # What the vehicle does now fades within half a second, so that it need not be learned; but how far
        # its speeds can be trusted is.
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


def interpolation() -> Tensor:
    """(KNOTS, H) values at the middle of each step from values at the knots."""
    at = (torch.arange(PLAN_STEPS) + 0.5) * (STEP_S / KNOT_S)
    return (1 - (at - torch.arange(KNOTS)[:, None]).abs()).clamp(min=0.0)


class GraphPredictorNet(nn.Module):
    """Plans along a path from the scene graph, the vehicle's history and the path ahead."""

    kind = "graph"

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.sizes = sizes
        self.scene = SceneEncoder(sizes)
        self.path_scale = Scaler(sizes.path_columns)
        self.path = mlp(sizes.path_columns, 2 * sizes.hidden, sizes.hidden)
        # Drivers keep their place in the lane: returned to the centreline they would be 0.4 m off after 3 s.
        self.head = PlanHead(replace(sizes, free=False), 2 * sizes.hidden, steers=True)

    def forward(self, scene: SceneBatch, path: PathBatch) -> Modes:
        """Modes of n pairs."""
        way = torch.relu(self.path(self.path_scale(path.features)))
        h = torch.cat([self.scene(scene, path.node), way], 1)
        modes: Modes = self.head(h, path.features)
        return modes
