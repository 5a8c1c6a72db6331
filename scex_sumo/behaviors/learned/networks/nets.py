"""The networks of the learned drivers as they run; `scex_sumo.training.networks` trains them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.behaviors.learned.networks.architecture import Architecture
from scex_sumo.behaviors.learned.networks.head import Modes, PlanHead
from scex_sumo.behaviors.learned.networks.image import ImageEncoder, MapImage
from scex_sumo.behaviors.learned.networks.layers import Mlp, Scaler, State, relu
from scex_sumo.behaviors.learned.networks.scene import SceneEncoder
from scex_sumo.behaviors.learned.seen.inputs import LEADER_COLUMNS, PathInputs
from scex_sumo.behaviors.scene_graph.graph import SceneGraph


class GraphNet:
    """Plans along a path from the scene graph, the vehicle's history and the path ahead."""

    def __init__(self, state: State, sizes: Architecture) -> None:
        self.sizes, self.scene = sizes, SceneEncoder(state, sizes)
        self.path_scale, self.path = Scaler(state, "path_scale"), Mlp(state, "path")
        self.head = PlanHead(state, sizes.modes)

    def __call__(self, graph: SceneGraph, path: PathInputs) -> Modes:
        """Modes of n pairs of a vehicle and a path."""
        way = relu(self.path(self.path_scale(path.features)))
        return self.head(np.concatenate([self.scene(graph, path.node), way], axis=1), path.features)


class GraphImageNet:
    """Plans from the scene graph and the road seen from above, weighed by the user: [w·g ; (1-w)·m].

    g knows the scene graph, the path ahead and who is on it; m knows the road seen from above, the path ahead
    and the own motion, but no other vehicle.
    """

    def __init__(self, state: State, sizes: Architecture) -> None:
        self.sizes, self.scene, self.image = sizes, SceneEncoder(state, sizes), ImageEncoder(state)
        self.path_scale, self.path, self.own = (
            Scaler(state, "path_scale"),
            Mlp(state, "path"),
            Mlp(state, "own"),
        )
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
        """Modes of n pairs of a vehicle and a path.

        Args:
            graph: of all vehicles.
            path: of the pairs.
            image: the map.
            pose: (K, 3) x, y, heading of the places from which vehicles see the road, m and rad.
            place: (n,) which of them is each pair's.
            attention: w in [0, 1]: 1 looks at the graph alone.
            free: also give the free trajectories, where the network has them.
        """
        features = self.path_scale(path.features)
        way, own = relu(self.path(features)), relu(self.own(features[:, : -len(LEADER_COLUMNS)]))
        g = relu(self.graph_branch(np.concatenate([self.scene(graph, path.node), way], axis=1)))
        m = relu(self.image_branch(np.concatenate([self.image(image, pose)[place], own], axis=1)))
        both = np.concatenate([attention * g, (1 - attention) * m], axis=1)
        return self.head(both, path.features, free=free and self.sizes.free)


Net: TypeAlias = GraphNet | GraphImageNet
KINDS: Mapping[str, type[GraphNet] | type[GraphImageNet]] = {"graph": GraphNet, "hybrid": GraphImageNet}
