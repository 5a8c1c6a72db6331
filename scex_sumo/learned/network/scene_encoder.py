"""Scene branch of the networks, with attention along the scene graph."""

from __future__ import annotations

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.graphs.graph import SceneGraph
from scex_sumo.learned.network.architecture import SLOPE, Architecture
from scex_sumo.learned.network.layers import Linear, Mlp, Norm, Scaler, State, relu

PAIRS = 1024  # of vehicles at a time, which fit the processor's cache


class EdgeAttention:
    """Graph attention layer with several heads (GATv2).

    The score of the edge from j to i is a . leaky_relu(L x_j + R x_i + E e_ij), with a softmax over i's
    edges.

    Source: Brody, Alon, Yahav 2022.
    """

    def __init__(self, state: State, name: str) -> None:
        self.key, self.query = Linear(state, f"{name}.lin_l"), Linear(state, f"{name}.lin_r")
        self.edge, self.bias = Linear(state, f"{name}.lin_edge"), state[f"{name}.bias"]
        _, self.heads, self.each = state[f"{name}.att"].shape
        same = np.repeat(np.eye(self.heads), self.each, axis=0)
        self.score = same * state[f"{name}.att"].reshape(-1, 1)  # from each head's columns to its score

    def __call__(
        self, node: FloatArray, graph: SceneGraph, some: IntArray, wanted: IntArray, scale: Scaler
    ) -> FloatArray:
        """Return (n, heads * each) of wanted nodes (n,).

        Args:
            node: (C, V, inner) of all vehicles of all futures.
            some: edges to the wanted nodes, ascending.
        """
        futures, vehicles, inner = node.shape
        key = self.key(node.reshape(-1, inner))
        query = np.empty_like(key)
        query[wanted] = self.query(node.reshape(-1, inner)[wanted])
        output = np.empty((futures, vehicles, self.heads, self.each))
        at_once, edges = max(1, PAIRS // vehicles**2), graph.edge_index[:, some]
        for first in range(0, futures, at_once):
            last = min(first + at_once, futures)
            low, high = np.searchsorted(edges[1], [first * vehicles, last * vehicles])
            source, target = edges[:, low:high]
            mixed = self.edge(scale(graph.edge[some[low:high]]))
            mixed += key[source]
            mixed += query[target]
            score = np.maximum(mixed, SLOPE * mixed, out=mixed) @ self.score
            weight = np.full((last - first, vehicles, self.heads, vehicles), -np.inf)
            row = ((target - first * vehicles) * self.heads)[:, None] + np.arange(self.heads)
            weight.reshape(-1)[row * vehicles + (source % vehicles)[:, None]] = score
            values = key[first * vehicles : last * vehicles].reshape(-1, vehicles, self.heads, self.each)
            sums = _softmax(weight).swapaxes(1, 2) @ values.swapaxes(1, 2)
            output[first:last] = sums.swapaxes(1, 2)
        taken = output.reshape(-1, self.heads * self.each)[wanted]
        taken += self.bias
        return taken


def _softmax(score: FloatArray) -> FloatArray:
    score -= np.maximum(score.max(axis=-1, keepdims=True), -1e300)  # for rows of -inf alone
    raised = np.exp(score, out=score)
    raised /= raised.sum(axis=-1, keepdims=True) + 1e-16
    return raised


class SceneEncoder:
    """Encoder of vehicles: history and properties, then attention along the scene graph."""

    def __init__(self, state: State, sizes: Architecture) -> None:
        self.hidden = sizes.hidden
        self.node_scale, self.edge_scale, self.history_scale = (
            Scaler(state, f"scene.{name}_scale") for name in ("node", "edge", "history")
        )
        self.embed = Mlp(state, "scene.embed")
        layers = range(sizes.attention_layers)
        self.attend = [EdgeAttention(state, f"scene.attend.{layer}") for layer in layers]
        self.norm = [Norm(state, f"scene.norm.{layer}") for layer in (*layers, len(layers))]

    def __call__(self, graph: SceneGraph, wanted: IntArray) -> FloatArray:
        """Return (n, hidden) of (n,) wanted nodes; others are left out."""
        reach = self._reach(graph, wanted)
        nodes = np.flatnonzero(reach[0])
        history = self.history_scale(graph.history.reshape(len(graph.history), -1)[nodes])
        h = np.zeros((len(reach[0]), self.hidden))
        inputs = np.concatenate([self.node_scale(graph.node[nodes]), history], axis=1)
        h[nodes] = self.norm[0](self.embed(inputs))
        vehicles = int(graph.vehicle.max(initial=-1)) + 1
        for attend, norm, needed in zip(self.attend, self.norm[1:], reach[1:], strict=True):
            some = np.flatnonzero(needed[graph.edge_index[1]])
            nodes = np.flatnonzero(needed)
            blocks = h.reshape(-1, vehicles, self.hidden)
            h[nodes] = norm(h[nodes] + relu(attend(blocks, graph, some, nodes, self.edge_scale)))
        return h[wanted]

    def _reach(self, graph: SceneGraph, wanted: IntArray) -> list[BoolArray]:
        needed = np.zeros(len(graph.node), dtype=np.bool_)
        needed[wanted] = True
        reach = [needed]
        for _ in self.attend:
            source, target = graph.edge_index
            needed = needed.copy()
            needed[source[reach[0][target]]] = True
            reach.insert(0, needed)
        return reach
