"""Batches of samples as tensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.learned.training.data.samples import TrainingSamples
from scex_sumo.learned.training.networks.graph import PathBatch, SceneBatch


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Some graphs, their n pairs of vehicle and path, and the targets, as in `TrainingSamples`.

    Attributes:
        share: (n,) weight in losses on trajectories: the site's weight over the vehicle's number of right
            paths; 0 where the path is not right.
    """

    scene: SceneBatch
    path: PathBatch
    right: Tensor  # (n,) whether the vehicle took the path
    share: Tensor
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
        self.node_start = _starts(samples.nodes)
        self.edge_start = _starts(samples.edges)
        self.pair_start = _starts(samples.pairs)
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
        node = self._index(self.node_start[graphs], nodes)
        edge = self._index(self.edge_start[graphs], edges)
        pair = self._index(self.pair_start[graphs], pairs)
        begin = _starts(nodes)
        edge_index = samples.edge_index[:, edge.cpu().numpy()] + np.repeat(begin, edges)
        pair_node = samples.pair_node[pair.cpu().numpy()] + np.repeat(begin, pairs)
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

    def _index(self, start: IntArray, count: IntArray) -> Tensor:
        index = np.arange(int(count.sum())) + np.repeat(start - _starts(count), count)
        return torch.as_tensor(index, device=self.device)

    def groups(self, order: IntArray, nodes: int) -> list[IntArray]:
        """Cut an order of graphs into batches of about so many nodes."""
        total = np.cumsum(self.samples.nodes[order])
        cuts = np.flatnonzero(np.diff((total - 1) // nodes)) + 1
        return [part for part in np.split(order, cuts) if len(part)]


def _starts(count: IntArray) -> IntArray:
    return np.asarray(np.cumsum(count) - count)
