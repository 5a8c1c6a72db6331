"""Scene graphs in other libraries hold what ours hold."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

import scex_sumo as scex
from scex_sumo.base.errors import MissingExtraError
from scex_sumo.graphs.graph import KINDS
from tests.behaviors.roads import lane, present, road, scene_of
from tests.test_examples import run_example

PARALLEL = road(lane(1, [(0.0, 0.0), (200.0, 0.0)], left=2), lane(2, [(0.0, 3.5), (200.0, 3.5)], right=1))
SCENE = scene_of((50.0, 0.0, 0.0, 9.0), (70.0, 0.0, 0.0, 7.0), (55.0, 3.5, 0.0, 9.0), (90.0, 30.0, 0.0, 9.0))


def two_futures() -> scex.SceneGraph:
    """In future 1 the third vehicle is gone from the second lane."""
    history = present(SCENE, 2)
    y = history.states.y.copy()
    y[1, 2] += 50.0
    return scex.scene_graph(replace(history, states=replace(history.states, y=y)), PARALLEL)


def test_networkx_gets_one_future_with_named_attributes() -> None:
    pytest.importorskip("networkx")
    graph = scex.scene_graph(SCENE, PARALLEL)
    made = scex.to_networkx(graph)
    assert made.number_of_nodes() == 4
    assert made.number_of_edges() == len(graph.edge_kind) == 6
    assert made.edges[1, 0]["kind"] == "ahead"
    assert made.edges[1, 0]["path_distance"] == pytest.approx(20.0)
    assert made.edges[2, 0]["kind"] == "lateral"
    assert made.nodes[1]["speed"] == 7.0
    assert made.nodes[1]["lane_id"] == 1
    assert made.nodes[1]["history"].shape == (11, 5)
    assert made.nodes[3]["lane_id"] is None and made.nodes[3]["arc"] is None


def test_pyg_gets_all_futures_with_an_edge_type_per_kind() -> None:
    pytest.importorskip("torch_geometric")
    graph = two_futures()
    data = scex.to_hetero_data(graph)
    assert data.validate()
    assert [relation for _, relation, _ in data.edge_types] == [*KINDS]
    assert np.allclose(data["vehicle"].x, graph.node, rtol=1e-6)  # float32
    assert data["vehicle"].future.tolist() == graph.future.tolist()
    for number, kind in enumerate(KINDS):
        mine = graph.edge_kind == number
        assert np.array_equal(data["vehicle", kind, "vehicle"].edge_index, graph.edge_index[:, mine])
        assert np.allclose(data["vehicle", kind, "vehicle"].edge_attr, graph.edge[mine], rtol=1e-6)
    assert data["vehicle", "intersecting", "vehicle"].edge_index.shape == (2, 0)
    run_example("to_hetero_data", {"scex": scex})


def test_without_networkx_the_export_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "networkx", None)
    with pytest.raises(MissingExtraError, match=r"needs networkx .* pip install '\.\[learned\]'"):
        scex.to_networkx(two_futures())
