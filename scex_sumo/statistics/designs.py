"""Balanced draw of assignments, which needs fewer futures than independent draws for the same certainty.

It gives every future (row) a level, a behaviour model, for each factor, a vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray

DECAY: Final = 0.3
"""Weight of a combination of k + 1 factors against one of k."""

BLOCK_ROWS: Final = 1024
_STARTS, _SWEEPS = 3, 3
_TIE: Final = 1e-9  # scores this close are equal


def balanced(shares: Sequence[Sequence[float] | FloatArray], rows: int, rng: np.random.Generator) -> IntArray:
    """Draw balanced rows one by one, so that each prefix is balanced, too.

    With the product kernel k(x, z) = prod over factors of (1 + DECAY * ([x = z] / share - 1)), the next row
    lowers the mean of k over all pairs of rows most: the squared discrepancy from the product of the shares.
    A coordinate search from random starts finds it (kernel herding). Blocks of 1024 rows are independent.

    Args:
        shares: per factor, the share of each of its levels; each sums to 1, none is 0.
        rng: draws ties and starts.

    Returns:
        (R, F) level of each factor in each row.

    Source: kernel herding, Chen, Welling, Smola 2010; qualitative factors, Hickernell, Liu 2002.
    """
    weights = [np.asarray(s, dtype=np.float64) for s in shares]
    own = [1 - DECAY + DECAY / w for w in weights]
    sums = [np.cumsum(w) for w in weights]
    edges = [upper[:-1] / upper[-1] for upper in sums]
    out = np.empty((rows, len(weights)), dtype=np.int64)
    for start in range(0, rows, BLOCK_ROWS):
        block = out[start : start + BLOCK_ROWS]
        # Column 0 is the kernel of each level with itself.
        kernels = [np.full((len(w), len(block) + 1), 1 - DECAY) for w in weights]
        for kernel, diagonal in zip(kernels, own, strict=True):
            kernel[:, 0] = diagonal
        for row in range(len(block)):
            block[row] = _next_row([k[:, : row + 1] for k in kernels], edges, rng)
            for factor, level in enumerate(block[row]):
                kernels[factor][level, row + 1] = own[factor][level]
    return out


def _next_row(
    kernels: Sequence[FloatArray], edges: Sequence[FloatArray], rng: np.random.Generator
) -> IntArray:
    """Return (F,) levels of the row that lowers the discrepancy most, by a search from a few starts.

    Args:
        kernels: per factor, (L, 1 + R) of its levels with themselves, and with those of the rows so far.
        edges: per factor, (L - 1,) bounds between its levels.
    """
    starts = _STARTS if kernels[0].shape[1] > 1 else 1
    points = rng.random((starts, len(edges))).T
    levels = [upper.searchsorted(draws, side="right") for upper, draws in zip(edges, points, strict=True)]
    rows = np.stack(levels, axis=1)
    if starts == 1:
        return rows.reshape(-1)
    sweeps = [rng.permutation(len(kernels)).tolist() for _ in range(_SWEEPS)]
    draws = rng.random(_SWEEPS * starts * sum(len(k) for k in kernels)).tolist()  # for ties, in order
    used = 0
    like = [k[rows[:, f]] for f, k in enumerate(kernels)]
    product = np.prod(like, axis=0)
    product[:, 0] *= 0.5
    added, levels = [0.0] * starts, rows.T.tolist()
    for sweep in sweeps:
        settled = True
        for factor in sweep:
            rest, mine = product / like[factor], levels[factor]
            before = list(mine)
            for start, scores in enumerate((rest @ kernels[factor].T).tolist()):
                added[start] = least = min(scores)
                if scores[mine[start]] > least + _TIE:
                    lowest = [level for level, score in enumerate(scores) if score <= least + _TIE]
                    mine[start] = max(lowest, key=draws[used : used + len(scores)].__getitem__)
                used += len(scores)
            if mine != before:
                settled = False
                like[factor] = kernels[factor][mine]
                product = rest * like[factor]
        if settled:
            break
    best = next(start for start in range(starts) if added[start] <= min(added) + _TIE)
    return np.array([mine[best] for mine in levels], dtype=np.int64)
