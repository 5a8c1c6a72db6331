"""How many children a seed gets: few at first, more where its place in the ranking is not clear.

A round ends when all its seeds are through, and the next is decided from whole rounds only: what is run
depends on neither workers nor interruptions nor the order in which seeds finish.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scex_sumo.arrays import IntArray
from scex_sumo.ranking.scores import Places, place
from scex_sumo.ranking.seeds import SeedRef

FIRST_CHILDREN = 32
NEARBY_S = 3.0
"""Two moments of a recording closer than a child is long show the same situation."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tally:
    """What a round found of a seed.

    Attributes:
        children: how many ran.
        critical: (M,) how many of them are critical by each metric that has a threshold.
        kept: how many of them have their tracks kept.
    """

    children: int
    critical: IntArray
    kept: int = 0


def round_ends(children: int, first: int = FIRST_CHILDREN) -> list[int]:
    """Children that a seed has after each round: doubled each time, up to ``children``."""
    ends = [min(first, children)]
    while ends[-1] < children:
        ends.append(min(2 * ends[-1], children))
    return ends


def standing(refs: Sequence[SeedRef], tallies: Mapping[str, Sequence[Tally]], *, seed: int) -> Places:
    """The places of seeds by all their rounds."""
    children = np.array([sum(t.children for t in tallies[ref.seed]) for ref in refs], dtype=np.int64)
    critical = np.array([sum(t.critical for t in tallies[ref.seed]) for ref in refs], dtype=np.int64)
    return place(critical.reshape(len(refs), -1), children, seed=seed)


def undecided(
    refs: Sequence[SeedRef], tallies: Mapping[str, Sequence[Tally]], number: int, *, top: int, seed: int
) -> list[SeedRef]:
    """The seeds that get more children in a round.

    Those that had children in the round before, may be among the moments on the page, and whose place is
    not certain.

    Args:
        refs: all seeds that have not failed, in the order of the dataset.
        tallies: by seed, its rounds so far; later ones than ``number`` are not looked at.
        number: of the round to come, from 1.
        top: moments on the page.
        seed: of the draws.
    """
    before = {ref.seed: list(tallies[ref.seed])[:number] for ref in refs if tallies.get(ref.seed)}
    known = [ref for ref in refs if ref.seed in before]
    if not known:
        return []
    places = standing(known, before, seed=seed)
    shown = distinct(known, places.order(), top)
    last = max((int(places.rank[i]) for i in shown), default=0)
    return [
        ref
        for i, ref in enumerate(known)
        if len(before[ref.seed]) == number and places.low[i] <= last and places.low[i] < places.high[i]
    ]


def distinct(refs: Sequence[SeedRef], order: Sequence[int], top: int) -> list[int]:
    """The best seeds that show different situations, as indices, best first.

    Of moments of one recording less than `NEARBY_S` apart only the best counts; cases are all different.

    Args:
        refs: the seeds.
        order: indices, best first.
        top: how many.
    """
    chosen: list[int] = []
    for i in order:
        if not any(nearby(refs[i], refs[j]) for j in chosen):
            chosen.append(i)
        if len(chosen) == top:
            break
    return chosen


def nearby(one: SeedRef, other: SeedRef) -> bool:
    """Whether two seeds show the same situation, or are the same."""
    if one.recording != other.recording or one.case or other.case:
        return one.seed == other.seed
    return abs(one.time_s - other.time_s) < NEARBY_S
