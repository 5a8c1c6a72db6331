"""Small networks with random weights, their scaling fitted to a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.graphs.graph import scene_graph
from scex_sumo.learned.inputs.path_inputs import path_inputs
from scex_sumo.learned.network.architecture import Architecture, shapes
from scex_sumo.learned.network.layers import exact
from scex_sumo.learned.network.networks import KINDS, Net
from scex_sumo.learned.network.weights import save_weights
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from tests.behaviors import roads

KIND_OF = {"graph_predictor": "graph", "graph_image_predictor": "hybrid", "joint_predictor": "joint"}
State = dict[str, np.ndarray]


def small(**numbers: Any) -> Architecture:
    return Architecture(**{"hidden": 16, "heads": 2, **numbers})


def drawn(kind: str, scene: SeedScene, road: Road, sizes: Architecture, *, loud: float = 3.0) -> State:
    """Random weights; the outputs are `loud` times what is usual, to have something to see."""
    rng, state = np.random.default_rng(7), {}
    for name, shape in shapes(kind, sizes).items():
        bound = 1 / np.sqrt(np.prod(shape[1:])) if len(shape) > 1 else 0.1
        state[name] = rng.uniform(-bound, bound, shape)
        if ".norm." in name and name.endswith("weight"):
            state[name] += 1.0
    history = roads.present(scene)
    vehicles, graph = roads.every(history), scene_graph(history, road)
    inputs = path_inputs(history, road, vehicles, *chosen_paths(history, road, vehicles, "straight"))
    fit(state, "scene.node_scale", graph.node)
    fit(state, "scene.history_scale", graph.history.reshape(len(graph.history), -1))
    fit(state, "scene.edge_scale", graph.edge)
    fit(state, "path_scale", inputs.features)
    if kind == "joint":
        state["head.acceleration"] = np.linspace(-4.0, 3.0, sizes.accelerations)
        state["head.sideways"] = np.linspace(-0.5, 0.5, sizes.sideways)
    else:
        state["head.knots.weight"] *= loud
    state["head.choice.weight"] *= loud
    return {name: values.astype(np.float32) for name, values in state.items()}


def fit(state: State, name: str, values: np.ndarray) -> None:
    """Means and spreads of a scene's inputs; what is constant, or there once, keeps its scale."""
    spread = values.std(axis=0) if len(values) > 1 else np.zeros(values.shape[1])
    state[f"{name}.mean"] = values.mean(axis=0) if len(values) else spread
    state[f"{name}.spread"] = np.where(spread > 1e-6, spread, 1.0)


def network(kind: str, scene: SeedScene, road: Road, *, loud: float = 3.0, **numbers: Any) -> Net:
    """A network of random weights."""
    sizes = small(**numbers)
    return KINDS[kind](exact(drawn(kind, scene, road, sizes, loud=loud))[0], sizes)


def untrained(folder: Path, name: str, scene: SeedScene, road: Road, **numbers: Any) -> Path:
    """A file of random weights for a learned driver."""
    file, kind, sizes = folder / f"{name}.safetensors", KIND_OF[name], small(**numbers)
    save_weights(file, kind, sizes, drawn(kind, scene, road, sizes), {"trained": "not at all"})
    return file
