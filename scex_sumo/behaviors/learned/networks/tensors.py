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
    columns: dict[str, Any] = {"node_columns": len(NODE_COLUMNS), "edge_columns": len(EDGE_COLUMNS)}
    return Architecture(**{**columns, **numbers})


def scene_batch(graph: SceneGraph, dtype: torch.dtype = torch.float64) -> SceneBatch:
    """A scene graph as tensors."""
    return SceneBatch(
        node=torch.from_numpy(np.ascontiguousarray(graph.node)).to(dtype),
        history=torch.from_numpy(np.ascontiguousarray(graph.history)).to(dtype),
        edge_index=torch.from_numpy(np.ascontiguousarray(graph.edge_index)),
        edge=torch.from_numpy(np.ascontiguousarray(graph.edge)).to(dtype),
    )


def path_batch(inputs: PathInputs, dtype: torch.dtype = torch.float64) -> PathBatch:
    """Path inputs as tensors."""
    return PathBatch(
        node=torch.from_numpy(np.ascontiguousarray(inputs.node)),
        features=torch.from_numpy(inputs.features).to(dtype),
    )


def map_image(road: Road, dtype: torch.dtype = torch.float64) -> MapImage:
    """A map's raster as tensors, without features of a network."""
    raster = raster_of(road)
    return MapImage(raster=torch.from_numpy(raster.values).to(dtype), corner=torch.from_numpy(raster.corner))
