"""Regression forest: extremely randomized trees on subsamples, with predictions out of bag.

Source: Geurts, Ernst, Wehenkel 2006.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray

TREES: Final = 30
LEAF: Final = 3
"""Samples in a leaf, at least."""

_BAG = 2 / 3
_LEAST, _RIDGE = 1e-3, 0.1  # added to values, and to the features' variance
_FLAT = 0.01  # share of the sum of squares of the root below which a node is not split


class _Tree(NamedTuple):
    slope: FloatArray  # (K,) of a linear model, which is one more feature
    feature: IntArray
    edge: FloatArray
    below: IntArray
    above: IntArray  # the node itself in leaves
    value: FloatArray

    def predict(self, features: FloatArray) -> FloatArray:
        features = _with_linear(features, self.slope)
        node, live = np.zeros(len(features), dtype=np.int64), np.arange(len(features))
        while len(live):
            at = node[live]
            low = features[live, self.feature[at]] <= self.edge[at]
            node[live] = np.where(low, self.below[at], self.above[at])
            live = live[node[live] != at]
        return self.value[node]


class Forest:
    """Forest fitted to samples with features (N, K) and values (N,) from 0 to 1."""

    def __init__(self, features: FloatArray, value: FloatArray, rng: np.random.Generator) -> None:
        count = len(features)
        bag = max(round(_BAG * count), min(2 * LEAF, count))
        self._bags = [np.sort(rng.permutation(count)[:bag]) for _ in range(TREES)]
        self._trees = [_grown(features[rows], value[rows], rng) for rows in self._bags]

    def predict(self, features: FloatArray, *, fitted: int, power: float = 1.0) -> FloatArray:
        """Return predictions (n,), the mean over trees of a power of their values.

        Args:
            fitted: number of the first samples that the forest was fitted to, in this order; only the trees
                that did not see such a sample predict it.
        """
        values = np.stack([tree.predict(features) for tree in self._trees]) ** power
        unseen = np.ones(values.shape, dtype=np.bool_)
        for row, bag in zip(unseen, self._bags, strict=True):
            row[bag[bag < fitted]] = False
        unseen[:, ~unseen.any(axis=0)] = True
        return np.asarray((values * unseen).sum(axis=0) / unseen.sum(axis=0))


def _with_linear(features: FloatArray, slope: FloatArray) -> FloatArray:
    return np.concatenate([features, (features @ slope)[:, None]], axis=1)


def _slope(features: FloatArray, value: FloatArray) -> FloatArray:
    """Return weights (K,) of the features in a ridge regression of the values' logarithm."""
    spread = np.maximum(features.std(axis=0), 1e-9)
    x, y = (features - features.mean(axis=0)) / spread, np.log(value + _LEAST)
    inner = x.T @ x + _RIDGE * len(x) * np.eye(x.shape[1])
    return np.asarray(np.linalg.solve(inner, x.T @ (y - y.mean())) / spread)


def _grown(features: FloatArray, value: FloatArray, rng: np.random.Generator) -> _Tree:
    slope = _slope(features, value)
    features = _with_linear(features, slope)
    nodes: list[list[float]] = []
    stack = [(np.arange(len(features)), -1, 0)]
    flat = _FLAT * float(((value - value.mean()) ** 2).sum())
    while stack:
        rows, parent, side = stack.pop()
        if parent >= 0:
            nodes[parent][side] = len(nodes)
        x, y, count = features[rows], value[rows], len(rows)
        mean, this = float(y.mean()), len(nodes)
        nodes.append([0, np.inf, this, this, mean])
        if count < 2 * LEAF or float(((y - mean) ** 2).sum()) <= flat:
            continue
        low = x.min(axis=0)
        edge = low + (x.max(axis=0) - low) * rng.random(x.shape[1])
        below = x <= edge
        number, total = below.sum(axis=0), y @ below
        inside = (number >= LEAF) & (count - number >= LEAF)
        number = np.where(inside, number, 1)
        gain = np.where(
            inside, total**2 / number + (y.sum() - total) ** 2 / np.maximum(count - number, 1), -1.0
        )
        k = int(np.argmax(gain))
        if gain[k] > 0:
            nodes[this][:2] = k, edge[k]
            stack += [(rows[below[:, k]], this, 2), (rows[~below[:, k]], this, 3)]
    feature, edge, below, above, mean = np.array(nodes).T
    return _Tree(slope, feature.astype(np.int64), edge, below.astype(np.int64), above.astype(np.int64), mean)
