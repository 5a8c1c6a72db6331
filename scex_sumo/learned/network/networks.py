"""Networks of the learned drivers in NumPy; `scex_sumo.learned.training.networks` trains them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.behaviors.base import PLAN_STEPS
from scex_sumo.graphs.graph import SceneGraph
from scex_sumo.learned.inputs.path_inputs import LEADER_COLUMNS, PathInputs
from scex_sumo.learned.network.architecture import (
    KNOT_S,
    KNOTS,
    OFFSET,
    PRESENT,
    SPEED,
    STRONGEST_ACCELERATION,
    STRONGEST_BRAKING,
    WIDEST_OFFSET_M,
    Architecture,
)
from scex_sumo.learned.network.encoders import ImageEncoder, MapImage, SceneEncoder
from scex_sumo.learned.network.layers import Linear, Mlp, Scaler, State, relu
from scex_sumo.scene import STEP_S


class PairEncoder:
    """Encoder of pairs of a vehicle and a path, from scene graph, history and path ahead."""

    def __init__(self, state: State, sizes: Architecture) -> None:
        self.sizes, self.scene = sizes, SceneEncoder(state, sizes)
        self.path_scale, self.path = Scaler(state, "path_scale"), Mlp(state, "path")

    def pairs(self, graph: SceneGraph, node: IntArray, features: FloatArray) -> FloatArray:
        """Return (n, inner) of n pairs of a node and scaled features of its path."""
        return np.concatenate([self.scene(graph, node), relu(self.path(features))], axis=1)


class GraphNet(PairEncoder):
    """Network from pairs to modes along the path."""

    def __init__(self, state: State, sizes: Architecture) -> None:
        super().__init__(state, sizes)
        self.head = PlanHead(state, sizes.modes)

    def __call__(self, graph: SceneGraph, path: PathInputs) -> Modes:
        """Return modes of n pairs of a vehicle and a path."""
        return self.head(self.pairs(graph, path.node, self.path_scale(path.features)), path.features)


class GraphImageNet(PairEncoder):
    """Network from scene graph and road image, weighed by the user: [w·g ; (1-w)·m].

    m sees the road image, the path ahead and the vehicle's motion, but no other vehicle.
    """

    def __init__(self, state: State, sizes: Architecture) -> None:
        super().__init__(state, sizes)
        self.image, self.own = ImageEncoder(state), Mlp(state, "own")
        self.graph_branch, self.image_branch = Mlp(state, "graph_branch"), Mlp(state, "image_branch")
        self.head = PlanHead(state, sizes.modes)

    def __call__(
        self,
        graph: SceneGraph,
        path: PathInputs,
        image: MapImage,
        pose: FloatArray,
        place: IntArray,
        attention: float,
        *,
        free: bool = False,
    ) -> Modes:
        """Return modes of n pairs of a vehicle and a path.

        Args:
            pose: (K, 3) x, y, heading of places from which vehicles see the road, m and rad.
            place: (n,) index of each pair's pose.
            attention: w in [0, 1]; 1 uses the graph alone.
        """
        features = self.path_scale(path.features)
        own = relu(self.own(features[:, : -len(LEADER_COLUMNS)]))
        g = relu(self.graph_branch(self.pairs(graph, path.node, features)))
        m = relu(self.image_branch(np.concatenate([self.image(image, pose)[place], own], axis=1)))
        both = np.concatenate([attention * g, (1 - attention) * m], axis=1)
        return self.head(both, path.features, free=free and self.sizes.free)


class JointNet(PairEncoder):
    """Network from pairs to the motion of the next 0.5 s."""

    def __init__(self, state: State, sizes: Architecture) -> None:
        super().__init__(state, sizes)
        self.body, self.choice = Mlp(state, "head.body"), Linear(state, "head.choice")
        self.acceleration, self.sideways = state["head.acceleration"], state["head.sideways"]

    def __call__(self, graph: SceneGraph, path: PathInputs) -> Tokens:
        """Return tokens of n pairs of a vehicle and a path."""
        h = relu(self.body(self.pairs(graph, path.node, self.path_scale(path.features))))
        choice = self.choice(h)
        return Tokens(choice[:, :-1], choice[:, -1], self.acceleration, self.sideways)


Net: TypeAlias = GraphNet | GraphImageNet | JointNet
KINDS: Mapping[str, type[Net]] = {"graph": GraphNet, "hybrid": GraphImageNet, "joint": JointNet}


class Tokens(NamedTuple):
    """Motions of the next 0.5 s: A classes of acceleration times S of sideways speed."""

    logits: FloatArray  # (n, A * S)
    path_logit: FloatArray  # (n,) of the path among those of its vehicle
    acceleration: FloatArray  # (A,) m/s², ascending
    sideways: FloatArray  # (S,) m/s along the path's normal, left positive, ascending


class Modes(NamedTuple):
    """M predictions of the next 3 s along each path; mode 0 is the expected one."""

    logits: FloatArray  # (n, M)
    acceleration: FloatArray  # (n, M, H) m/s², between -9 and 5
    offset: FloatArray  # (n, M, H) wanted distance left of the path, m
    path_logit: FloatArray  # (n,) of the path among those of its vehicle
    # (n, M, H, 2) x ahead and y to the left of the present pose, m; None if not requested
    free: FloatArray | None


class PlanHead:
    """Head from one vector per pair to modes: knots every 0.5 s, linear between."""

    def __init__(self, state: State, modes: int) -> None:
        self.body, self.modes = Mlp(state, "head.body"), modes
        self.knots, self.choice = Linear(state, "head.knots"), Linear(state, "head.choice")
        self.between = interpolation().astype(np.float64)

    def __call__(self, h: FloatArray, features: FloatArray, *, free: bool = False) -> Modes:
        """Return modes of (n, inner) vectors and the raw `features` of the pairs."""
        h = relu(self.body(h))
        choice = self.choice(h)
        knots = self.knots(h).reshape(len(h), self.modes, -1)
        trust = 1 / (1 + np.exp(np.minimum(-choice[:, self.modes + 1 :], 700.0)))  # no overflow
        present = (trust * np.clip(features[:, PRESENT], -4.0, 4.0)).sum(axis=1)
        along, aside = knots[..., :KNOTS], knots[..., KNOTS : 2 * KNOTS - 1]
        return Modes(
            logits=choice[:, : self.modes],
            acceleration=self._acceleration(along, present),
            offset=self._offset(aside, features[:, OFFSET]),
            path_logit=choice[:, self.modes],
            free=self._free(knots[..., 2 * KNOTS - 1 :], features[:, SPEED]) if free else None,
        )

    def _acceleration(self, knots: FloatArray, present: FloatArray) -> FloatArray:
        wanted = knots + present[:, None, None] * np.exp(-np.arange(float(KNOTS)))
        limit = np.where(wanted > 0, STRONGEST_ACCELERATION, STRONGEST_BRAKING)
        wanted /= limit
        bounded = np.tanh(wanted, out=wanted)
        bounded *= limit
        return np.asarray(bounded @ self.between)

    def _offset(self, knots: FloatArray, present: FloatArray) -> FloatArray:
        change = WIDEST_OFFSET_M * np.tanh(knots / WIDEST_OFFSET_M)
        return change @ self.between[1:] + present[:, None, None]  # at the first knot it is 0

    def _free(self, knots: FloatArray, speed: FloatArray) -> FloatArray:
        knots = knots.reshape(*knots.shape[:2], KNOTS, 2)
        ahead = knots[..., 0] @ self.between + speed[:, None, None]
        left = knots[..., 1] @ self.between
        return np.cumsum(np.stack([ahead, left], axis=-1), axis=2) * STEP_S


def interpolation() -> FloatArray:
    """Return (KNOTS, H) weights from the knots to the middle of each step; float32, as in training."""
    knots = np.arange(KNOTS, dtype=np.float32)[:, None]
    middles = (np.arange(PLAN_STEPS, dtype=np.float32) + 0.5) * (STEP_S / KNOT_S)
    return np.asarray(np.maximum(1 - np.abs(middles - knots), 0))
