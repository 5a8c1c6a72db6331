"""Attention along edges: by hand, and to the bit the layer of PyTorch Geometric."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")

from scex_sumo.learned.training.networks.graph import EdgeAttentionModule  # noqa: E402


@pytest.mark.parametrize("kind", [torch.float32, torch.float64])
def test_numbers_are_those_of_pytorch_geometric(kind: torch.dtype) -> None:
    geometric = pytest.importorskip("torch_geometric.nn")
    torch.manual_seed(3)
    theirs = geometric.GATv2Conv(8, 4, heads=3, edge_dim=5, add_self_loops=False)
    after = torch.rand(1)
    torch.manual_seed(3)
    ours = EdgeAttentionModule(8, 4, heads=3, edge_columns=5)
    assert torch.equal(torch.rand(1), after)
    assert {k: v.tolist() for k, v in ours.state_dict().items()} == {
        k: v.tolist() for k, v in theirs.state_dict().items()
    }
    node, edge = torch.randn(40, 8, dtype=kind), torch.randn(300, 5, dtype=kind)
    edges = torch.randint(0, 39, (2, 300))
    ours.to(kind), theirs.to(kind)
    assert torch.equal(ours(node, edges, edge, node), theirs(node, edges, edge))
