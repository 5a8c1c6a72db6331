"""Branches of the networks: vehicles, with attention along the scene graph, and the road seen from above."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.graphs.graph import SceneGraph
from scex_sumo.learned.inputs.surface import CHANNELS, PIXEL_M, Raster
from scex_sumo.learned.network.architecture import (
    AHEAD_M,
    ASIDE_M,
    CONVOLUTIONS,
    COS,
    FEATURES,
    SIN,
    SLOPE,
    STRIDE,
    Architecture,
    Convolution,
)
from scex_sumo.learned.network.layers import Linear, Mlp, Norm, Scaler, State, relu, snapped

PAIRS = 1024  # of vehicles at a time, which fit the processor's cache
PLACES = 64  # at a time, which fit the processor's cache
STRIP, HALO = 128, 16  # rows of a map at a time, and rows around them that convolutions reach


class EdgeAttention:
    """Graph attention layer with several heads (GATv2).

    The score of the edge from j to i is a . leaky_relu(L x_j + R x_i + E e_ij), with a softmax over i's
    edges.

    Source: Brody, Alon, Yahav 2022.
    """

    def __init__(self, state: State, name: str) -> None:
        self.key, self.query = Linear(state, f"{name}.lin_l"), Linear(state, f"{name}.lin_r")
        self.edge, self.bias = Linear(state, f"{name}.lin_edge"), state[f"{name}.bias"]
        _, self.heads, self.per_head = state[f"{name}.att"].shape
        same = np.repeat(np.eye(self.heads), self.per_head, axis=0)
        self.score = same * state[f"{name}.att"].reshape(-1, 1)  # from each head's columns to its score

    def __call__(
        self, node: FloatArray, graph: SceneGraph, edges: IntArray, wanted: IntArray, scale: Scaler
    ) -> FloatArray:
        """Return (n, heads * per_head) of wanted nodes (n,).

        Args:
            node: (C, V, inner) of all vehicles of all futures.
            edges: numbers of the edges to the wanted nodes, ascending.
        """
        futures, vehicles, inner = node.shape
        key = self.key(node.reshape(-1, inner))
        query = np.empty_like(key)
        query[wanted] = self.query(node.reshape(-1, inner)[wanted])
        output = np.empty((futures, vehicles, self.heads, self.per_head))
        at_once, edge_index = max(1, PAIRS // vehicles**2), graph.edge_index[:, edges]
        for first in range(0, futures, at_once):
            last = min(first + at_once, futures)
            low, high = np.searchsorted(edge_index[1], [first * vehicles, last * vehicles])
            source, target = edge_index[:, low:high]
            mixed = self.edge(scale(graph.edge[edges[low:high]]))
            mixed += key[source]
            mixed += query[target]
            score = np.maximum(mixed, SLOPE * mixed, out=mixed) @ self.score
            weight = np.full((last - first, vehicles, self.heads, vehicles), -np.inf)
            weight[target // vehicles - first, target % vehicles, :, source % vehicles] = score
            values = key[first * vehicles : last * vehicles].reshape(-1, vehicles, self.heads, self.per_head)
            sums = _softmax(weight).swapaxes(1, 2) @ values.swapaxes(1, 2)
            output[first:last] = sums.swapaxes(1, 2)
        taken = output.reshape(-1, self.heads * self.per_head)[wanted]
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
            edges = np.flatnonzero(needed[graph.edge_index[1]])
            nodes = np.flatnonzero(needed)
            blocks = h.reshape(-1, vehicles, self.hidden)
            h[nodes] = norm(h[nodes] + relu(attend(blocks, graph, edges, nodes, self.edge_scale)))
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


class MapImage(NamedTuple):
    """Raster and features of a map, each with a border of zeros."""

    raster: FloatArray  # (7, R + 2, C + 2), see `Raster`
    features: FloatArray  # (10, R' + 2, C' + 2) of `ImageEncoder.features_of`
    corner: FloatArray  # (2,) m, of the raster's first pixel

    @classmethod
    def of(cls, raster: Raster, features: FloatArray) -> MapImage:
        """Frame a raster and its (10, R', C') features."""
        return cls(_framed(raster.values), _framed(features), raster.corner)


class ImageEncoder:
    """Encoder of the road around a vehicle."""

    def __init__(self, state: State) -> None:
        weights = (state[f"image.convolve.{2 * index}.weight"] for index in range(len(CONVOLUTIONS)))
        self.weights = [w.transpose(2, 3, 1, 0).reshape(-1, len(w)) for w in weights]
        self.biases = [state[f"image.convolve.{2 * index}.bias"] for index in range(len(CONVOLUTIONS))]
        grid = np.stack(np.meshgrid(AHEAD_M, ASIDE_M, indexing="ij"), axis=-1).reshape(-1, 2)
        self.ahead, self.aside = grid.T
        self.read = Mlp(state, "image.read")

    def features_of(self, raster: Raster) -> FloatArray:
        """Return (10, R', C') features of a map, strip by strip to limit the memory."""
        values = raster.values.transpose(1, 2, 0)
        strips = []
        for first in range(0, len(values), STRIP):
            top = max(first - HALO, 0)
            strip, start = self.features(values[top : first + STRIP + HALO]), (first - top) // STRIDE
            strips.append(strip[start : start + STRIP // STRIDE])
        return np.concatenate(strips).transpose(2, 0, 1)

    def features(self, values: FloatArray) -> FloatArray:
        """Return (R', C', 10) of (R, C, 7)."""
        for layer, weight, bias in zip(CONVOLUTIONS, self.weights, self.biases, strict=True):
            values = relu(values) if layer is not CONVOLUTIONS[0] else values
            values = _convolved(snapped(values), layer, weight)
            values += bias
        return snapped(values)

    def __call__(self, image: MapImage, pose: FloatArray) -> FloatArray:
        """Return (K, hidden) of (K, 3) places x, y, heading on the map, m and rad."""
        firsts = range(0, max(len(pose), 1), PLACES)
        return np.concatenate([self._read(image, pose[first : first + PLACES]) for first in firsts])

    def _read(self, image: MapImage, pose: FloatArray) -> FloatArray:
        x, y, heading = (column[:, None] for column in pose.T)
        cos, sin = np.cos(heading), np.sin(heading)
        u = (x + cos * self.ahead - sin * self.aside - image.corner[0]) / PIXEL_M
        v = (y + sin * self.ahead + cos * self.aside - image.corner[1]) / PIXEL_M
        seen = np.empty((len(pose), len(CHANNELS) + FEATURES, len(self.ahead)))
        seen[:, : len(CHANNELS)] = _sampled(image.raster, u, v)
        seen[:, len(CHANNELS) :] = _sampled(image.features, u / STRIDE, v / STRIDE)
        along, across = seen[:, COS].copy(), seen[:, SIN].copy()
        # directions of lanes relative to the vehicle's
        seen[:, COS] = cos * along + sin * across
        seen[:, SIN] = cos * across - sin * along
        return self.read(seen.reshape(len(pose), -1))


def _framed(values: FloatArray) -> FloatArray:
    return np.pad(values, ((0, 0), (1, 1), (1, 1)))


def _convolved(values: FloatArray, layer: Convolution, weight: FloatArray) -> FloatArray:
    pad, step, apart = layer.padding, layer.stride, layer.dilation
    padded = np.pad(values, ((pad, pad), (pad, pad), (0, 0)))
    reach = apart * (layer.side - 1)
    rows, columns = ((size - reach - 1) // step + 1 for size in padded.shape[:2])
    windows = np.empty((rows, columns, layer.side**2, layer.inner))
    for k in range(layer.side**2):
        i, j = (apart * offset for offset in divmod(k, layer.side))
        windows[:, :, k] = padded[i : i + step * rows : step, j : j + step * columns : step]
    products: FloatArray = windows.reshape(rows * columns, -1) @ weight
    return products.reshape(rows, columns, -1)


def _sampled(framed: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    channels, rows, columns = framed.shape
    u, v = np.clip(u + 1, 0, columns - 1), np.clip(v + 1, 0, rows - 1)
    j = np.minimum(u.astype(np.int64), columns - 2)
    i = np.minimum(v.astype(np.int64), rows - 2)
    fj, fi = u - j, v - i
    flat, index = framed.reshape(channels, -1), i * columns + j
    values: FloatArray = flat.take(index, axis=1, mode="clip") * ((1 - fi) * (1 - fj))
    for beside, share in ((1, (1 - fi) * fj), (columns, fi * (1 - fj)), (columns + 1, fi * fj)):
        corner = flat.take(index + beside, axis=1, mode="clip")
        corner *= share
        values += corner
    return values.swapaxes(0, 1)
