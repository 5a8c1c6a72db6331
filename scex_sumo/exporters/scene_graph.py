"""Scene graph export to networkx and PyTorch Geometric."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.base.errors import MissingExtraError, UsageError
from scex_sumo.behaviors.scene_graph.graph import KINDS, SceneGraph

if TYPE_CHECKING:
    from networkx import DiGraph
    from torch_geometric.data import HeteroData


def to_networkx(graph: SceneGraph, child: int = 0) -> DiGraph[int]:
    """Convert the graph of one child, an index into the batch, to a `networkx.DiGraph`.

    Nodes are vehicle indices, with `SceneGraph.node_columns`, ``history`` (11, 5), ``lane_id`` and ``arc``
    (None off the road). Edges have ``kind`` (of `KINDS`) and `SceneGraph.edge_columns`.

    Raises:
        MissingExtraError: networkx is not installed.
        UsageError: the batch has no such child.

    Example:
        >>> scex.to_networkx(scex.scene_graph(scene)).number_of_nodes()
        14
    """
    try:
        import networkx
    except ImportError as error:
        raise MissingExtraError(
            "this export needs networkx; pip install 'scex-sumo[learned]' or networkx"
        ) from error
    rows = np.flatnonzero(graph.child == child)
    if not len(rows):
        count = len(np.unique(graph.child))
        raise UsageError(f"scene graph: child {child} of a batch of {count}; choose 0 to {count - 1}")
    made: DiGraph[int] = networkx.DiGraph()
    for row in rows:
        on_road = bool(graph.on_road[row])
        made.add_node(
            int(graph.vehicle[row]),
            history=graph.history[row].copy(),
            lane_id=int(graph.lane_id[row]) if on_road else None,
            arc=float(graph.arc[row]) if on_road else None,
            **_named(graph.node_columns, graph.node[row]),
        )
    source, target = graph.edge_index
    for k in np.flatnonzero(graph.child[target] == child):
        made.add_edge(
            int(graph.vehicle[source[k]]),
            int(graph.vehicle[target[k]]),
            kind=KINDS[graph.edge_kind[k]],
            **_named(graph.edge_columns, graph.edge[k]),
        )
    return made


def _named(columns: tuple[str, ...], values: Any) -> dict[str, float]:
    return dict(zip(columns, values.tolist(), strict=True))


def to_hetero_data(graph: SceneGraph) -> HeteroData:
    """Convert the graphs of all children to one `torch_geometric.data.HeteroData`.

    Nodes ``vehicle`` have ``x`` (N, F), ``history`` (N, 11, 5), ``child`` (N,), ``vehicle`` (N,). Edges
    ``("vehicle", kind, "vehicle")`` have ``edge_index`` (2, E), ``edge_attr`` (E, G). Floats are float32.
    Names of columns: ``node_columns``, ``history_columns``, ``edge_columns``.

    Raises:
        MissingExtraError: torch or torch-geometric is not installed.

    Example:
        >>> scex.to_hetero_data(scex.scene_graph(scene))["vehicle"].x.shape[0]
        14
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
