"""Small networks with random weights, their scaling fitted to a scene."""

from __future__ import annotations

from pathlib import Path

import torch

from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.learned.networks.graph import GraphPredictorNet
from scex_sumo.behaviors.learned.networks.graph_image import GraphImageNet
from scex_sumo.behaviors.learned.networks.tensors import architecture
from scex_sumo.behaviors.learned.seen.inputs import path_inputs
from scex_sumo.behaviors.learned.weights import KINDS, save_weights
from scex_sumo.behaviors.scene_graph.graph import scene_graph
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from tests.behaviors import roads

KIND_OF = {"graph_predictor": "graph", "graph_image_predictor": "hybrid"}


def network(
    kind: str, scene: SeedScene, road: Road, *, loud: float = 3.0, **numbers: int | bool
) -> GraphPredictorNet | GraphImageNet:
    """Random weights; the outputs are `loud` times what they are initialised to, to have something to see."""
    torch.manual_seed(7)
    net = KINDS[kind](architecture(**{"hidden": 16, "heads": 2, **numbers}))
    history = roads.present(scene)
    who = roads.every(history)
    graph = scene_graph(history, road)
    paths, row = chosen_paths(history, road, who, "straight")
    inputs = path_inputs(history, road, who, paths, row)
    net.scene.node_scale.fit(torch.from_numpy(graph.node))
    net.scene.history_scale.fit(torch.from_numpy(graph.history).flatten(1))
    if len(graph.edge) > 1:
        net.scene.edge_scale.fit(torch.from_numpy(graph.edge))
    net.path_scale.fit(torch.from_numpy(inputs.features))
    with torch.no_grad():
        net.head.knots.weight.mul_(loud)
        net.head.choice.weight.mul_(loud)
    return net


def untrained(folder: Path, name: str, scene: SeedScene, road: Road, **numbers: int | bool) -> Path:
    """A file of random weights for a learned driver."""
    file = folder / f"{name}.pt"
    save_weights(file, network(KIND_OF[name], scene, road, **numbers), {"trained": "not at all"})
    return file
