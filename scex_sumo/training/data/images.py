"""Map images for training the image branch: turned by a random quarter, and the vehicle with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from scex_sumo.behaviors.learned.networks.architecture import COS, SIN
from scex_sumo.behaviors.learned.seen.raster import PIXEL_M, raster_of
from scex_sumo.road import Road
from scex_sumo.training.data.batches import Batch
from scex_sumo.training.networks.graph_image import ImageBatch, MapTensors


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
    """Maps of all sites, each in four directions, and the same as in a mirror.

    Attributes:
        maps: (S, 8) by site and number of quarter turns; from 4 on mirrored first.
    """

    maps: tuple[tuple[MapTensors, ...], ...]

    @classmethod
    def of_roads(cls, roads: Sequence[Road], device: torch.device) -> Images:
        """Draw the maps of some roads."""
        return cls(
            maps=tuple(
                (*_turns(image), *_turns(_mirrored(image)))
                for image in (_image(road, device) for road in roads)
            )
        )

    def batch(self, batch: Batch, turns: int = 0, *, mirrored: bool = False) -> ImageBatch:
        """What the vehicles of a batch see, one place per pair, after some quarter turns of everything.

        Args:
            batch: K pairs.
            turns: 0 to 3.
            mirrored: the batch has been mirrored, see `mirror`.
        """
        present, site = torch.unique(batch.site, return_inverse=True)
        return ImageBatch(
            maps=tuple(self.maps[int(s)][turns + 4 * mirrored] for s in present),
            site=site,
            pose=turned(batch.pose, turns),
            place=torch.arange(len(site), device=site.device),
        )


def turned(pose: Tensor, turns: int) -> Tensor:
    """Poses (n, 3) turned by quarters about the origin, counter-clockwise."""
    x, y, heading = pose.unbind(1)
    for _ in range(turns):
        x, y, heading = -y, x, heading + np.pi / 2
    return torch.stack([x, y, heading], 1)


def _image(road: Road, device: torch.device) -> MapTensors:
    raster = raster_of(road)
    values = torch.from_numpy(raster.values).float()
    return MapTensors(raster=values.to(device), corner=torch.from_numpy(raster.corner).to(device))


def _mirrored(image: MapTensors) -> MapTensors:
    """A map mirrored about the x axis."""
    values = image.raster.flip(1)
    values[SIN] = -values[SIN]
    height = PIXEL_M * (values.shape[1] - 1)
    return MapTensors(raster=values, corner=torch.stack([image.corner[0], -(image.corner[1] + height)]))


def _turns(image: MapTensors) -> list[MapTensors]:
    """A map in four directions: 0, 1, 2, 3 quarter turns counter-clockwise about the origin."""
    images, values, corner = [image], image.raster, image.corner
    for _ in range(3):
        height = PIXEL_M * (values.shape[1] - 1)
        corner = torch.stack([-(corner[1] + height), corner[0]])
        # The pixel in row i and column j goes to row j, and to a column that counts from the other side.
        values = values.flip(1).transpose(1, 2).contiguous()
        values[COS], values[SIN] = -values[SIN].clone(), values[COS].clone()
        images.append(MapTensors(raster=values, corner=corner))
    return images
