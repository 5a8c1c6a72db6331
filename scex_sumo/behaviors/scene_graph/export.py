"""Semantic scene graphs for networkx."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from scex_sumo.behaviors.scene_graph.graph import KINDS, SceneGraph
from scex_sumo.errors import MissingExtraError, UsageError

if TYPE_CHECKING:
    from networkx import DiGraph


def to_networkx(graph: SceneGraph, child: int = 0) -> DiGraph[int]:
    """The graph of one child as a `networkx.DiGraph`.

    Nodes are indices into the seed scene's vehicles. Their attributes are `SceneGraph.node_columns` as
    numbers, ``history`` (11, 5), ``lane_id`` and ``arc`` (None off the road). An edge runs from the vehicle
    that influences to the one that is influenced; its attributes are ``kind`` (a word of `KINDS`) and
    `SceneGraph.edge_columns` as numbers. All in SI units.

    Args:
        child: index into the batch.

    Raises:
        MissingExtraError: networkx is not installed.
        UsageError: the batch has no such child.
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
