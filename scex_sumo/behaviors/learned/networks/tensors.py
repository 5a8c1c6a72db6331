"""Tensors that networks take, from NumPy inputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from scex_sumo.behaviors.learned.networks.graph import Architecture, PathBatch, SceneBatch
from scex_sumo.behaviors.learned.networks.graph_image import MapImage
from scex_sumo.behaviors.learned.seen.inputs import PathInputs
from scex_sumo.behaviors.learned.seen.raster import raster_of
from scex_sumo.behaviors.scene_graph.graph import EDGE_COLUMNS, NODE_COLUMNS, SceneGraph
from scex_sumo.road import Road


def architecture(**numbers: int | bool) -> Architecture:
    """The shipped sizes for the columns that scene graphs and path inputs have; any number can be changed."""
    sizes: dict[str, Any] = {"node_columns": len(NODE_COLUMNS), "edge_columns": len(EDGE_COLUMNS), **numbers}
    return Architecture(**sizes)


def scene_batch(graph: SceneGraph) -> SceneBatch:
    """A scene graph as float64 tensors."""
    parts = (graph.node, graph.history, graph.edge_index, graph.edge)
    return SceneBatch(*(torch.from_numpy(np.ascontiguousarray(part)) for part in parts))


def path_batch(inputs: PathInputs) -> PathBatch:
    """Path inputs as float64 tensors."""
    return PathBatch(
        node=torch.from_numpy(np.ascontiguousarray(inputs.node)), features=torch.from_numpy(inputs.features)
    )


def map_image(road: Road, dtype: torch.dtype = torch.float64) -> MapImage:
    """A map's raster as tensors, without features of a network."""
    raster = raster_of(road)
    return MapImage(raster=torch.from_numpy(raster.values).to(dtype), corner=torch.from_numpy(raster.corner))
