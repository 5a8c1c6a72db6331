"""Networks by the name that `scex-sumo train` gives them, and their files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

from scex_sumo.behaviors.learned.weights import save_weights
from scex_sumo.training.networks.graph import GraphPredictorNet
from scex_sumo.training.networks.graph_image import GraphImagePredictorNet

Net: TypeAlias = GraphPredictorNet | GraphImagePredictorNet
KINDS: Mapping[str, type[GraphPredictorNet] | type[GraphImagePredictorNet]] = {
    net.kind: net for net in (GraphPredictorNet, GraphImagePredictorNet)
}


def save_net(path: str | Path, net: Net, meta: Mapping[str, Any]) -> None:
    """Write a network's weights; see `save_weights`."""
    state = {name: values.detach().cpu().numpy() for name, values in net.state_dict().items()}
    save_weights(path, net.kind, net.sizes, state, meta)
