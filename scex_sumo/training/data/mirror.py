"""Batches as in a mirror: left becomes right; drivers then steer the other way, and nothing else changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from scex_sumo.behaviors.learned.seen.inputs import PATH_COLUMNS
from scex_sumo.behaviors.scene_graph.graph import EDGE_COLUMNS, HISTORY_COLUMNS, NODE_COLUMNS
from scex_sumo.training.data.batches import Batch

AHEAD = ("y_", "heading_", "curvature_")  # columns of the path ahead, at all distances
LEFT, RIGHT = PATH_COLUMNS.index("room_left"), PATH_COLUMNS.index("room_right")


def _signs(columns: Sequence[str], sideways: Sequence[str]) -> Tensor:
    """(columns,) -1 for what changes its sign, else 1."""
    missing = [name for name in sideways if name not in columns]
    assert not missing, missing
    return torch.tensor([-1.0 if name in sideways else 1.0 for name in columns])


NODE = _signs(NODE_COLUMNS, ("yaw_rate", "lane_offset", "lane_heading_error", "obstacle_offset"))
HISTORY = _signs(HISTORY_COLUMNS, ("y", "sin"))
EDGE = _signs(EDGE_COLUMNS, ("target_offset", "source_offset", "y", "sin"))
SIDEWAYS = ("yaw_rate", "offset", "heading_error", "yaw_rate_error")
PATH = _signs(PATH_COLUMNS, [*SIDEWAYS, *(name for name in PATH_COLUMNS if name.startswith(AHEAD))])


def mirrored(batch: Batch) -> Batch:
    """A batch about the x axis of the map; its vehicles' own frames are mirrored about their headings."""
    device = batch.s.device
    features = batch.path.features * PATH.to(device)
    order = torch.arange(features.shape[1], device=device)
    order[LEFT], order[RIGHT] = RIGHT, LEFT
    return replace(
        batch,
        scene=batch.scene._replace(
            node=batch.scene.node * NODE.to(device),
            history=batch.scene.history * HISTORY.to(device),
            edge=batch.scene.edge * EDGE.to(device),
        ),
        path=batch.path._replace(features=features[:, order]),
        pose=batch.pose * torch.tensor([1.0, -1.0, -1.0], dtype=batch.pose.dtype, device=device),
        d=-batch.d,
        start=batch.start * torch.tensor([1.0, -1.0, -1.0, -1.0], device=device),
        xy=batch.xy * torch.tensor([1.0, -1.0], device=device),
    )
