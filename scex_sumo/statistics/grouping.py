"""Groups of runs: hierarchical clustering of a distance matrix, and how good a grouping is."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.errors import UsageError

METHODS: Final = ("ward", "average")


@dataclass(frozen=True, kw_only=True, eq=False)
class Grouping:
    """Groups of runs and the tree they were cut from.

    Attributes:
        linkage: (R - 1, 4) as scipy writes trees: the two parts joined, height, size. Heights are in units of
            the distance: two runs that join have theirs.
        order: (R,) the runs as the tree's leaves, similar ones side by side.
        group: (R,) number of each run's group, from 1 on in the order of the leaves.
        silhouette: (R,) how much better each run fits its own group than the next one, -1 to 1.
    """

    linkage: FloatArray
    order: IntArray
    group: IntArray
    silhouette: FloatArray

    @property
    def groups(self) -> int:
        """Number of groups."""
        return int(self.group.max())


def group_runs(
    distance: FloatArray, labels: Sequence[str], *, groups: int | None = None, method: str = "ward"
) -> Grouping:
    """Hierarchical clustering of runs.

    ``ward`` joins the two groups that then spread least, on the root of the distance: distances that are
    areas between distributions become squared Euclidean ones by that, which is what Ward's criterion needs.
    ``average`` joins the two whose runs are nearest on average, and tends to leave single runs alone. The
    result does not depend on the order of the runs: ties are broken by name.

    Args:
        distance: (R, R) symmetric, 0 on the diagonal.
        labels: (R,) different names.
        groups: how many to cut the tree into, 1 to R; None takes 2 to R - 1, whichever has the largest mean
            silhouette (two runs are two groups).

    Raises:
        UsageError: a number of groups that is not there, or an unknown method.
    """
    from scipy.cluster.hierarchy import fcluster, leaves_list, linkage
    from scipy.spatial.distance import squareform

    count = len(labels)
    if groups is not None and not 1 <= groups <= count:
        raise UsageError(f"--groups: got {groups}, needs 1 to {count}, the number of runs")
    if method not in METHODS:
        raise UsageError(f"unknown linkage {method!r}; known: {', '.join(METHODS)}")
    by_name = np.argsort(np.asarray(labels), kind="stable")
    condensed = squareform(distance[np.ix_(by_name, by_name)], checks=False)
    power = 2 if method == "ward" else 1
    tree = linkage(condensed ** (1 / power), method=method, optimal_ordering=True)
    tree[:, 2] **= power
    leaves = np.asarray(leaves_list(tree), dtype=np.int64)
    choices = range(2, max(count, 3)) if groups is None else (groups,)
    best: tuple[float, IntArray, FloatArray] | None = None
    for choice in choices:
        group = np.empty(count, dtype=np.int64)
        group[by_name] = _numbered(np.asarray(fcluster(tree, choice, criterion="maxclust")), leaves)
        fit = silhouette(distance, group.tolist())
        # A later choice must be better by more than rounding.
        if best is None or fit.mean() > best[0] + 1e-12:
            best = (float(fit.mean()), group, fit)
    assert best is not None
    joined = tree[:, :2]
    joined[joined < count] = by_name[joined[joined < count].astype(np.int64)]
    return Grouping(linkage=tree, order=by_name[leaves], group=best[1], silhouette=best[2])


def _numbered(group: IntArray, leaves: IntArray) -> IntArray:
    """Groups renamed 1, 2, ... in the order in which the leaves meet them."""
    names: dict[int, int] = {}
    for leaf in leaves:
        names.setdefault(int(group[leaf]), len(names) + 1)
    return np.array([names[int(g)] for g in group], dtype=np.int64)


def silhouette(distance: FloatArray, groups: Sequence[Hashable]) -> FloatArray:
    """How much better each run fits its own group than the next best, -1 to 1 (Rousseeuw 1987).

    (b - a) / max(a, b) with the mean distance a to the others of its group and b to those of the nearest
    other group; 0 for a run alone in its group, and where there is only one group.

    Args:
        distance: (R, R).
        groups: (R,) names of the groups.
    """
    member = np.array([[g == name for g in groups] for name in dict.fromkeys(groups)])
    sizes = member.sum(axis=1)
    if len(sizes) < 2:
        return np.zeros(len(groups))
    sums = distance @ member.T
    own = member.argmax(axis=0)
    rows = np.arange(len(groups))
    within = sums[rows, own] / np.maximum(sizes[own] - 1, 1)
    mean = sums / sizes
    mean[rows, own] = np.inf
    between = mean.min(axis=1)
    larger = np.maximum(within, between)
    fit = np.divide(between - within, larger, where=larger > 0, out=np.zeros(len(groups)))
    return np.where(sizes[own] > 1, fit, 0.0)
