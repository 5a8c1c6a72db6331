"""How often the 95 % intervals and bands hold, and how wide they are, against all assignments.

Run: python benchmarks/intervals.py CACHE [--set chosen|fresh] [--scenes N] [--repetitions N]

Every scene has five vehicles, each driven by one of four models: all 1024 assignments are run once and kept
in CACHE (about 5 s a scene). Then designs are drawn again and again: P(critical) of all thresholds,
P(collision), of every pair of vehicles P(collision) and P(critical), and the bands of all columns, against
the truth. Shares whose truth is 0 or 1 are left out, and columns that fewer than a fifth of the futures
define, or that have fewer than three values.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.interval_truths import LEVELS, SETS, VEHICLES, Truth, truths
from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.statistics.density import dkw_half_width, wilson_of
from scex_sumo.statistics.designs import balanced
from scex_sumo.statistics.intervals import DesignIntervals

SIZES = (117, 385)
SHAPE = (LEVELS,) * VEHICLES
_NORMAL = 1.96
_HEADINGS = ("design", "futures", "question", "cases", "holds", "lowest 5 %", "worst")
_HEADINGS += ("width", "true spread", "ratio", "ordinary")


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """Intervals of cases, each a question of a scene: what is found in R repetitions.

    Attributes:
        names: (M,) the questions.
        holds: (M,) share of the repetitions in which the interval holds the truth.
        width: (M,) mean of its width, of a band its half-width.
        spread: (M,) true width: 2 · 1.96 root mean squared errors, of bands the 95th percentile of KS.
        ordinary: (M,) mean width of the interval of independent draws.
    """

    names: Sequence[str]
    holds: FloatArray
    width: FloatArray
    spread: FloatArray
    ordinary: FloatArray


def shares(found: Sequence[Truth], draws: Sequence[IntArray], made: Sequence[DesignIntervals]) -> Found:
    """Intervals of all shares that are neither 0 nor 1."""
    answers = np.concatenate([truth.answers for truth in found], axis=1)
    names = np.array([name for truth in found for name in truth.questions])
    real = answers.mean(axis=0)
    open_ = (real > 0) & (real < 1)
    answers, names, real = answers[:, open_], names[open_], real[open_]
    known = [mine.all_shares(answers[rows]) for mine, rows in zip(made, draws, strict=True)]
    value, low, high = (
        np.array([[getattr(share, end) for share in row] for row in known])
        for end in ("value", "low", "high")
    )
    ordinary = [[wilson_of(p.value, p.count) for p in row] for row in known]
    return Found(
        names=names.tolist(),
        holds=((low - 1e-12 <= real) & (real <= high + 1e-12)).mean(axis=0),
        width=(high - low).mean(axis=0),
        spread=2 * _NORMAL * np.sqrt(np.mean((value - real) ** 2, axis=0)),
        ordinary=np.mean([[high - low for low, high in row] for row in ordinary], axis=0),
    )


def bands(found: Sequence[Truth], draws: Sequence[IntArray], made: Sequence[DesignIntervals]) -> Found:
    """Bands of all columns that enough futures define."""
    values = np.concatenate([truth.values for truth in found], axis=1)
    kept = [v for v in values.T if np.mean(~np.isnan(v)) >= 0.2 and len(np.unique(v[~np.isnan(v)])) >= 3]
    half = np.array([mine.half_widths(np.stack(kept)[:, r].T) for mine, r in zip(made, draws, strict=True)])
    apart = np.array([[_distance(v, v[rows]) for v in kept] for rows in draws])
    ordinary = np.array([[dkw_half_width(int((~np.isnan(v[r])).sum())) for v in kept] for r in draws])
    return Found(
        names=["bands"] * len(kept),
        holds=(apart <= half).mean(axis=0),
        width=half.mean(axis=0),
        spread=np.quantile(apart, 0.95, axis=0),
        ordinary=ordinary.mean(axis=0),
    )


def _distance(one: FloatArray, two: FloatArray) -> float:
    """Kolmogorov-Smirnov distance of samples, without those that are undefined."""
    one, two = (np.sort(values[~np.isnan(values)]) for values in (one, two))
    ranks = [np.searchsorted(values, one, side="right") / max(len(values), 1) for values in (one, two)]
    return float(np.abs(ranks[0] - ranks[1]).max())


def line(head: str, name: str, found: Found, those: Sequence[int]) -> str:
    """A row of the table: means over some cases."""
    holds, width, spread, ordinary = (
        np.asarray(part)[those] for part in (found.holds, found.width, found.spread, found.ordinary)
    )
    often = f"{holds.mean():.1%} | {np.quantile(holds, 0.05):.0%} | {holds.min():.0%}"
    wide = f"{width.mean():.3f} | {spread.mean():.3f} | {width.mean() / spread.mean():.2f}"
    return f"| {head} | {name} | {len(those)} | {often} | {wide} | {ordinary.mean():.3f} |"


def drawn(design: str, shares: Sequence[FloatArray], size: int, seed: int) -> IntArray:
    """Levels (size, V) of the balanced draw, or of independent ones."""
    rng = np.random.default_rng([9, seed])
    return balanced(shares, size, rng) if design == "balanced" else rng.integers(0, LEVELS, (size, VEHICLES))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cache", type=Path)
    parser.add_argument("--set", choices=SETS, default="fresh")
    parser.add_argument("--scenes", type=int, default=36)
    parser.add_argument("--repetitions", type=int, default=200)
    given = parser.parse_args()
    found = truths(given.cache, given.set, given.scenes)
    print(f"{len(found)} scenes: {', '.join(truth.name for truth in found)}")
    print("| " + " | ".join(_HEADINGS) + " |\n" + "|---" * len(_HEADINGS) + "|")
    even = [np.full(LEVELS, 1 / LEVELS)] * VEHICLES
    for design in ("balanced", "random"):
        for size in SIZES:
            head = f"{design} | {size}"
            seeds = range(given.repetitions)
            levels = [drawn(design, even, size, seed) for seed in seeds]
            draws = [np.ravel_multi_index(tuple(rows.T), SHAPE).astype(np.int64) for rows in levels]
            made = [DesignIntervals(rows, design=design, shares=even) for rows in levels]
            asked = shares(found, draws, made)
            for name in dict.fromkeys(asked.names):
                those = [i for i, other in enumerate(asked.names) if other == name]
                print(line(head, f"P({name})", asked, those), flush=True)
            print(line(head, "all P", asked, range(len(asked.names))))
            widths = bands(found, draws, made)
            print(line(head, "bands", widths, range(len(widths.names))), flush=True)


if __name__ == "__main__":
    main()
