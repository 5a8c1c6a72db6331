"""Augmented batches: mirrored, with map images in four directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from scex_sumo.graphs.graph import EDGE_COLUMNS, HISTORY_COLUMNS, NODE_COLUMNS
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS
from scex_sumo.learned.inputs.raster import PIXEL_M, raster_of
from scex_sumo.learned.network.architecture import COS, SIN
from scex_sumo.learned.training.data.batches import Batch
from scex_sumo.learned.training.networks.graph_image import ImageBatch, MapTensors
from scex_sumo.road import Road

AHEAD = ("y_", "heading_", "curvature_")  # columns of the path ahead, at all distances
LEFT, RIGHT = PATH_COLUMNS.index("room_left"), PATH_COLUMNS.index("room_right")


def _signs(columns: Sequence[str], sideways: Sequence[str]) -> Tensor:
    missing = [name for name in sideways if name not in columns]
    assert not missing, missing
    return torch.tensor([-1.0 if name in sideways else 1.0 for name in columns])


NODE = _signs(NODE_COLUMNS, ("yaw_rate", "lane_offset", "lane_heading_error", "obstacle_offset"))
HISTORY = _signs(HISTORY_COLUMNS, ("y", "sin"))
EDGE = _signs(EDGE_COLUMNS, ("target_offset", "source_offset", "y", "sin"))
SIDEWAYS = ("yaw_rate", "offset", "heading_error", "yaw_rate_error")
PATH = _signs(PATH_COLUMNS, [*SIDEWAYS, *(name for name in PATH_COLUMNS if name.startswith(AHEAD))])


def mirrored(batch: Batch) -> Batch:
    """Mirror a batch about the x axis of the map; vehicles' own frames about their headings."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
    """Maps of all sites, each in four directions and mirrored.

    Attributes:
        maps: (S, 8) by site and number of quarter turns; from 4 on mirrored first.
    """

    maps: tuple[tuple[MapTensors, ...], ...]

    @classmethod
    def of_roads(cls, roads: Sequence[Road], device: torch.device) -> Images:
        """Draw the maps."""
        return cls(
            maps=tuple(
                (*_turns(image), *_turns(_mirrored(image)))
                for image in (_image(road, device) for road in roads)
            )
        )

    def batch(self, batch: Batch, turns: int = 0, *, mirrored: bool = False) -> ImageBatch:
        """Return the maps for a batch after 0 to 3 quarter turns, one place per pair."""
        present, site = torch.unique(batch.site, return_inverse=True)
        return ImageBatch(
            maps=tuple(self.maps[int(s)][turns + 4 * mirrored] for s in present),
            site=site,
            pose=turned(batch.pose, turns),
            place=torch.arange(len(site), device=site.device),
        )


def turned(pose: Tensor, turns: int) -> Tensor:
    """Turn poses (n, 3) by quarters about the origin, counter-clockwise."""
    x, y, heading = pose.unbind(1)
    for _ in range(turns):
        x, y, heading = -y, x, heading + np.pi / 2
    return torch.stack([x, y, heading], 1)


def _image(road: Road, device: torch.device) -> MapTensors:
    raster = raster_of(road)
    values = torch.from_numpy(raster.values).float()
    return MapTensors(raster=values.to(device), corner=torch.from_numpy(raster.corner).to(device))


def _mirrored(image: MapTensors) -> MapTensors:
    values = image.raster.flip(1)
    values[SIN] = -values[SIN]
    height = PIXEL_M * (values.shape[1] - 1)
    return MapTensors(raster=values, corner=torch.stack([image.corner[0], -(image.corner[1] + height)]))


def _turns(image: MapTensors) -> list[MapTensors]:
    images, values, corner = [image], image.raster, image.corner
    for _ in range(3):
        height = PIXEL_M * (values.shape[1] - 1)
        corner = torch.stack([-(corner[1] + height), corner[0]])
        # The pixel in row i and column j goes to row j, and to a column that counts from the other side.
        values = values.flip(1).transpose(1, 2).contiguous()
        values[COS], values[SIN] = -values[SIN].clone(), values[COS].clone()
        images.append(MapTensors(raster=values, corner=corner))
    return images
