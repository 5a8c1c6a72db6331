"""Semantic scene graphs for PyTorch Geometric."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from scex_sumo.behaviors.scene_graph.graph import KINDS, SceneGraph
from scex_sumo.errors import MissingExtraError

if TYPE_CHECKING:
    from torch_geometric.data import HeteroData


def to_hetero_data(graph: SceneGraph) -> HeteroData:
    """The graphs of all children as one `torch_geometric.data.HeteroData`.

    Node type ``vehicle`` with ``x`` (N, F), ``history`` (N, 11, 5), ``child`` (N,) and ``vehicle`` (N,); one
    edge type ``("vehicle", kind, "vehicle")`` for each of `KINDS`, also where there is no such edge, with
    ``edge_index`` (2, E) and ``edge_attr`` (E, G). Floats are float32, in SI units. The names of the columns
    are in ``node_columns``, ``history_columns`` and ``edge_columns``.

    Raises:
        MissingExtraError: torch or torch-geometric is not installed.
    """
    try:
        import torch
        from torch_geometric.data import HeteroData
    except ImportError as error:
        raise MissingExtraError(
            "this export needs PyTorch Geometric; pip install 'scex-sumo[learned]' or torch-geometric"
        ) from error
    data = HeteroData()
    nodes: Any = data["vehicle"]
    nodes.x = torch.tensor(graph.node, dtype=torch.float32)
    nodes.history = torch.tensor(graph.history, dtype=torch.float32)
    nodes.child, nodes.vehicle = torch.tensor(graph.child), torch.tensor(graph.vehicle)
    for number, kind in enumerate(KINDS):
        mine = graph.edge_kind == number
        edges: Any = data["vehicle", kind, "vehicle"]
        edges.edge_index = torch.tensor(graph.edge_index[:, mine])
        edges.edge_attr = torch.tensor(graph.edge[mine], dtype=torch.float32)
    data.node_columns, data.history_columns = graph.node_columns, graph.history_columns
    data.edge_columns = graph.edge_columns
    return data
