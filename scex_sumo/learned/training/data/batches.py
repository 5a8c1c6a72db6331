"""Batches of samples as tensors, also mirrored, with map images in four directions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.graphs.graph import EDGE_COLUMNS, HISTORY_COLUMNS, NODE_COLUMNS
from scex_sumo.learned.inputs.path_inputs import PATH_COLUMNS
from scex_sumo.learned.inputs.surface import PIXEL_M, raster_of
from scex_sumo.learned.network.architecture import COS, SIN
from scex_sumo.learned.training.data.samples import TrainingSamples
from scex_sumo.learned.training.networks.graph import PathBatch, SceneBatch
from scex_sumo.learned.training.networks.graph_image import ImageBatch, MapTensors
from scex_sumo.road import Road

AHEAD = ("y_", "heading_", "curvature_")  # columns of the path ahead, at all distances
LEFT, RIGHT = PATH_COLUMNS.index("room_left"), PATH_COLUMNS.index("room_right")


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Some graphs, their n pairs of vehicle and path, and the targets, as in `TrainingSamples`."""

    scene: SceneBatch
    path: PathBatch
    right: Tensor  # (n,) whether the vehicle took the path
    share: Tensor  # (n,) weight in losses: the site's over the vehicle's number of right paths; 0: not right
    site: Tensor  # (n,) number of the site
    pose: Tensor  # (n, 3) x, y, heading on the map
    s: Tensor
    d: Tensor
    start: Tensor
    xy: Tensor


class Batches:
    """Samples as tensors.

    Args:
        site_weight: (S,) weight of each site's graphs in the loss.
    """

    def __init__(self, samples: TrainingSamples, site_weight: FloatArray, device: torch.device) -> None:
        self.samples, self.device = samples, device
        counts = samples.nodes, samples.edges, samples.pairs
        self.node_start, self.edge_start, self.pair_start = (_starts(count) for count in counts)
        graph = np.repeat(np.arange(len(samples)), samples.pairs)
        node = self.node_start[graph] + samples.pair_node
        rights = np.bincount(node[samples.right], minlength=int(samples.nodes.sum()))
        share = samples.right / np.maximum(rights[node], 1) * site_weight[samples.site[graph]]
        self._node, self._history = self._tensor(samples.node), self._tensor(samples.history)
        self._edge, self._feature = self._tensor(samples.edge), self._tensor(samples.feature)
        self._pairs = {
            "right": torch.as_tensor(samples.right, device=device),
            "share": self._tensor(share),
            "site": torch.as_tensor(samples.site[graph], device=device),
            "pose": torch.as_tensor(samples.pose[node], device=device),  # float64: maps may lie far away
            **{name: self._tensor(getattr(samples, name)) for name in ("s", "d", "start", "xy")},
        }

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.as_tensor(np.asarray(values, dtype=np.float32), device=self.device)

    def take(self, graphs: IntArray) -> Batch:
        """Return some graphs as one batch."""
        samples = self.samples
        nodes, edges, pairs = samples.nodes[graphs], samples.edges[graphs], samples.pairs[graphs]
        node = _ranges(self.node_start[graphs], nodes)
        edge = _ranges(self.edge_start[graphs], edges)
        pair = _ranges(self.pair_start[graphs], pairs)
        begin = _starts(nodes)
        edge_index = samples.edge_index[:, edge] + np.repeat(begin, edges)
        pair_node = samples.pair_node[pair] + np.repeat(begin, pairs)
        return Batch(
            scene=SceneBatch(
                node=self._node[node],
                history=self._history[node],
                edge_index=torch.as_tensor(edge_index, device=self.device),
                edge=self._edge[edge],
            ),
            path=PathBatch(node=torch.as_tensor(pair_node, device=self.device), features=self._feature[pair]),
            **{name: values[pair] for name, values in self._pairs.items()},
        )

    def groups(self, order: IntArray, nodes: int) -> list[IntArray]:
        """Cut an order of graphs into batches of about so many nodes."""
        total = np.cumsum(self.samples.nodes[order])
        cuts = np.flatnonzero(np.diff((total - 1) // nodes)) + 1
        return [group for group in np.split(order, cuts) if len(group)]


def _starts(count: IntArray) -> IntArray:
    return np.asarray(np.cumsum(count) - count)


def _ranges(start: IntArray, count: IntArray) -> IntArray:
    return np.asarray(np.arange(int(count.sum())) + np.repeat(start - _starts(count), count))


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


class Images:
    """Maps (S, 8) of all sites by number of quarter turns; from 4 on mirrored first."""

    def __init__(self, roads: Sequence[Road], device: torch.device) -> None:
        rasters = (raster_of(road) for road in roads)
        images = [
            MapTensors(torch.from_numpy(r.values).float().to(device), torch.from_numpy(r.corner).to(device))
            for r in rasters
        ]
        self.maps = [[*_turns(image), *_turns(_mirrored(image))] for image in images]

    def batch(self, batch: Batch, turns: int = 0, *, mirrored: bool = False) -> ImageBatch:
        """Return the maps for a batch after 0 to 3 quarter turns, one place per pair."""
        present, site = torch.unique(batch.site, return_inverse=True)
        maps = tuple(self.maps[int(s)][turns + 4 * mirrored] for s in present)
        return ImageBatch(maps, site, turned(batch.pose, turns))


def turned(pose: Tensor, turns: int) -> Tensor:
    """Turn poses (n, 3) by quarters about the origin, counter-clockwise."""
    x, y, heading = pose.unbind(1)
    for _ in range(turns):
        x, y, heading = -y, x, heading + np.pi / 2
    return torch.stack([x, y, heading], 1)


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
