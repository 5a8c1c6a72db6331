"""Network of the Graph Image Predictor in training, and the networks by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import torch
from torch import Tensor, nn
from torch.nn.functional import grid_sample

from scex_sumo.learned.inputs.path_inputs import LEADER_COLUMNS
from scex_sumo.learned.inputs.surface import CHANNELS, PIXEL_M
from scex_sumo.learned.network.architecture import (
    AHEAD_M,
    ASIDE_M,
    CONVOLUTIONS,
    COS,
    FEATURES,
    SIN,
    STRIDE,
    Architecture,
    shapes,
)
from scex_sumo.learned.network.weights import save_weights
from scex_sumo.learned.training.networks.graph import (
    GraphPredictorNet,
    JointPredictorNet,
    ModeTensors,
    PathBatch,
    PlanHeadModule,
    ScalerModule,
    SceneBatch,
    SceneModule,
    mlp,
)


class MapTensors(NamedTuple):
    """One map: (7, R, C) raster and (2,) corner, see `Raster`."""

    raster: Tensor
    corner: Tensor


class ImageBatch(NamedTuple):
    """n places from which vehicles see the road, one for each pair of a vehicle and a path."""

    maps: tuple[MapTensors, ...]
    site: Tensor  # (n,) index into ``maps``
    pose: Tensor  # (n, 3) x, y, heading on the map; float64, because maps may lie far from the origin


class ImageModule(nn.Module):
    """Vectors of the road around vehicles, as `ImageEncoder`."""

    ahead: Tensor
    aside: Tensor

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for c in CONVOLUTIONS:
            layers += [nn.ReLU()] if layers else []
            layers.append(nn.Conv2d(c.inner, c.outer, c.side, c.stride, c.padding, c.dilation))
        self.convolve = nn.Sequential(*layers)
        points = len(AHEAD_M) * len(ASIDE_M)
        self.read = mlp(points * (FEATURES + len(CHANNELS)), 2 * sizes.hidden, sizes.hidden)
        grid = torch.cartesian_prod(torch.tensor(AHEAD_M), torch.tensor(ASIDE_M))
        self.register_buffer("ahead", grid[:, 0].contiguous(), persistent=False)
        self.register_buffer("aside", grid[:, 1].contiguous(), persistent=False)

    def forward(self, image: ImageBatch) -> Tensor:
        """Return (n, hidden) of the places."""
        dtype = self.ahead.dtype
        x, y, heading = image.pose.unbind(1)
        cos, sin = torch.cos(heading), torch.sin(heading)
        px = x[:, None] + cos[:, None] * self.ahead - sin[:, None] * self.aside
        py = y[:, None] + sin[:, None] * self.ahead + cos[:, None] * self.aside
        size = len(CHANNELS) + FEATURES
        seen = torch.zeros(len(x), size, len(self.ahead), dtype=dtype, device=px.device)
        for index, where in enumerate(image.maps):
            on_map = torch.nonzero(image.site == index)[:, 0]
            if len(on_map):
                seen[on_map] = self._sample(where, px[on_map], py[on_map]).to(dtype)
        read: Tensor = self.read(self._turned(seen, cos.to(dtype), sin.to(dtype)).flatten(1))
        return read

    def _sample(self, where: MapTensors, px: Tensor, py: Tensor) -> Tensor:
        features = self.convolve(where.raster[None])[0]
        u, v = (px - where.corner[0]) / PIXEL_M, (py - where.corner[1]) / PIXEL_M
        parts = []
        for values, stride in ((where.raster, 1), (features, STRIDE)):
            rows, columns = values.shape[1:]
            # grid_sample counts from -1 at the first to 1 at the last pixel's centre.
            grid = torch.stack(
                [2 * u / stride / max(columns - 1, 1) - 1, 2 * v / stride / max(rows - 1, 1) - 1], -1
            )
            parts.append(grid_sample(values[None], grid[None].to(values.dtype), align_corners=True)[0])
        return torch.cat(parts).transpose(0, 1)

    def _turned(self, seen: Tensor, cos: Tensor, sin: Tensor) -> Tensor:
        turned = seen.clone()
        turned[:, COS] = cos[:, None] * seen[:, COS] + sin[:, None] * seen[:, SIN]
        turned[:, SIN] = cos[:, None] * seen[:, SIN] - sin[:, None] * seen[:, COS]
        return turned


class GraphImagePredictorNet(nn.Module):
    """Network of the Graph Image Predictor, as `GraphImageNet`."""

    kind = "hybrid"

    def __init__(self, sizes: Architecture) -> None:
        super().__init__()
        self.sizes = sizes
        hidden, alone = sizes.hidden, sizes.path_columns - len(LEADER_COLUMNS)
        self.scene, self.image = SceneModule(sizes), ImageModule(sizes)
        self.path_scale = ScalerModule(sizes.path_columns)
        self.path = mlp(sizes.path_columns, 2 * hidden, hidden)
        self.own = mlp(alone, 2 * hidden, hidden)
        self.graph_branch = mlp(2 * hidden, 2 * hidden, hidden)
        self.image_branch = mlp(2 * hidden, 2 * hidden, hidden)
        self.head = PlanHeadModule(sizes)

    def forward(
        self, scene: SceneBatch, path: PathBatch, image: ImageBatch, attention: Tensor
    ) -> ModeTensors:
        """Return modes of n pairs; `attention` is w, (n,) in [0, 1]: 1 uses the graph alone."""
        features = self.path_scale(path.features)
        alone = features[:, : -len(LEADER_COLUMNS)]
        encoded, own = torch.relu(self.path(features)), torch.relu(self.own(alone))
        g = torch.relu(self.graph_branch(torch.cat([self.scene(scene, path.node), encoded], 1)))
        m = torch.relu(self.image_branch(torch.cat([self.image(image), own], 1)))
        w = attention[:, None]
        modes: ModeTensors = self.head(torch.cat([w * g, (1 - w) * m], 1), path.features)
        return modes


Net: TypeAlias = GraphPredictorNet | GraphImagePredictorNet | JointPredictorNet
NETWORKS: Mapping[str, type[Net]] = {
    net.kind: net for net in (GraphPredictorNet, GraphImagePredictorNet, JointPredictorNet)
}


def save_net(path: Path, net: Net, meta: Mapping[str, Any]) -> None:
    """Write the weights that a network's driver needs; see `save_weights`."""
    state = net.state_dict()
    needed = {name: state[name].detach().cpu().numpy() for name in shapes(net.kind, net.sizes)}
    save_weights(path, net.kind, net.sizes, needed, meta)
