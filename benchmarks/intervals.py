"""How often the 95 % intervals and bands hold, and how wide they are, against all assignments.

Run: python benchmarks/intervals.py CACHE [--scenes N] [--repetitions N]

Every scene has five vehicles, each driven by one of four models: all 1024 assignments are run once and kept
in CACHE (about 2 s a scene). Then designs are drawn again and again: P(critical) of the four thresholds,
P(collision) and the bands of the twelve columns against the truth. Shares whose truth is 0 or 1 are left out,
and columns that fewer than a fifth of the children define, or that have fewer than three values.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.interval_truths import LEVELS, VEHICLES, Truth, truths
from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.metrics.outlines.collisions import find_collisions
from scex_sumo.metrics.registry import PAPER_METRICS, THRESHOLDS, side_of
from scex_sumo.statistics.density import dkw_half_width, wilson
from scex_sumo.statistics.designs import DESIGNS
from scex_sumo.statistics.intervals import DesignIntervals

SIZES = (117, 385)
SHAPE = (LEVELS,) * VEHICLES
_NORMAL = 1.96


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """Intervals of one question: share of repetitions that hold, width, true spread, ordinary width."""

    holds: float
    width: float
    spread: float
    ordinary: float


def questions(truth: Truth) -> tuple[list[str], BoolArray]:
    """Names and (N, Q) answers: critical by each threshold, and collision."""
    names, answers = ["collision"], [find_collisions(truth.tracks).any_of(len(truth.values))]
    for name in (name for name in PAPER_METRICS if name in THRESHOLDS):
        threshold = THRESHOLDS[name]
        column = truth.values[:, truth.columns.index(name)]
        with np.errstate(invalid="ignore"):  # undefined is not critical
            hit = column <= threshold if side_of(name) == "left" else column >= threshold
        names.append(name)
        answers.append(hit & ~np.isnan(column))
    return names, np.stack(answers, axis=1)


def shares(found: list[Truth], draws: list[IntArray], made: list[DesignIntervals]) -> dict[str, list[Found]]:
    """By question, one entry per scene."""
    table: dict[str, list[Found]] = {}
    for truth in found:
        names, answers = questions(truth)
        real = answers.mean(axis=0)
        known = [d.all_shares(answers[rows]) for d, rows in zip(made, draws, strict=True)]
        for index, name in enumerate(names):
            if not 0 < real[index] < 1:
                continue
            mine = [intervals[index] for intervals in known]
            holds = [i.low - 1e-12 <= real[index] <= i.high + 1e-12 for i in mine]
            ordinary = [wilson(round(i.value * i.count), i.count) for i in mine]
            error = np.sqrt(np.mean([(i.value - real[index]) ** 2 for i in mine]))
            table.setdefault(name, []).append(
                Found(
                    holds=float(np.mean(holds)),
                    width=float(np.mean([i.high - i.low for i in mine])),
                    spread=float(2 * _NORMAL * error),
                    ordinary=float(np.mean([i.high - i.low for i in ordinary])),
                )
            )
    return table


def bands(found: list[Truth], draws: list[IntArray], made: list[DesignIntervals]) -> list[Found]:
    """One entry per scene and column; width and spread are half-widths and the 95th percentile of KS."""
    table = []
    for truth in found:
        for values in truth.values.T:
            known = np.sort(values[~np.isnan(values)])
            if len(known) < 0.2 * len(values) or len(np.unique(known)) < 3:
                continue
            apart, half, ordinary = [], [], []
            for intervals, rows in zip(made, draws, strict=True):
                mine = values[rows]
                apart.append(_distance(known, np.sort(mine[~np.isnan(mine)])))
                half.append(intervals.half_width(mine))
                ordinary.append(dkw_half_width(int((~np.isnan(mine)).sum())))
            table.append(
                Found(
                    holds=float(np.mean(np.array(apart) <= half)),
                    width=float(np.mean(half)),
                    spread=float(np.quantile(apart, 0.95)),
                    ordinary=float(np.mean(ordinary)),
                )
            )
    return table


def _distance(one: FloatArray, two: FloatArray) -> float:
    """Kolmogorov-Smirnov distance of sorted samples."""
    at = np.unique(one)
    ranks = [np.searchsorted(values, at, side="right") / len(values) for values in (one, two)]
    return float(np.abs(ranks[0] - ranks[1]).max())


def line(design: str, size: int, name: str, found: list[Found]) -> str:
    """A row of the table."""
    holds, width, spread, ordinary = (
        float(np.mean([getattr(f, part) for f in found])) for part in ("holds", "width", "spread", "ordinary")
    )
    worst = min(f.holds for f in found)
    return (
        f"| {design} | {size} | {name} | {len(found)} | {holds:.1%} | {worst:.0%} | {width:.3f} "
        f"| {spread:.3f} | {width / spread:.2f} | {ordinary:.3f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cache", type=Path)
    parser.add_argument("--scenes", type=int, default=24)
    parser.add_argument("--repetitions", type=int, default=40)
    given = parser.parse_args()
    found = truths(given.cache, given.scenes)
    print(f"{len(found)} scenes: {', '.join(truth.name for truth in found)}")
    print("| design | children | question | cases | holds | worst | width | true spread | ratio | ordinary |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    even = [np.full(LEVELS, 1 / LEVELS)] * VEHICLES
    for design in ("balanced", "random"):
        for size in SIZES:
            seeds = range(given.repetitions)
            levels = [DESIGNS[design](even, size, np.random.default_rng([9, seed])) for seed in seeds]
            draws = [np.ravel_multi_index(tuple(rows.T), SHAPE).astype(np.int64) for rows in levels]
            made = [DesignIntervals(rows, design=design, shares=even) for rows in levels]
            by_name = shares(found, draws, made)
            for name, entries in by_name.items():
                print(line(design, size, f"P({name})", entries), flush=True)
            print(line(design, size, "all P", [e for entries in by_name.values() for e in entries]))
            print(line(design, size, "bands", bands(found, draws, made)), flush=True)


if __name__ == "__main__":
    main()
