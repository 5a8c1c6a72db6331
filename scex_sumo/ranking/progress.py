"""The rounds of a ranking: which seeds get how many children, and what is known of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.ranking.folder import RankFolder
from scex_sumo.ranking.read_ahead import read_ahead
from scex_sumo.ranking.rounds import Tally, round_ends, undecided
from scex_sumo.ranking.seeds import Failure, Listing, SeedRef
from scex_sumo.ranking.task import KEEP_MOST, critical_by
from scex_sumo.ranking.tasks import Plan, Wanted, cut
from scex_sumo.ranking.workers import Crew, Order, Outcome

_AHEAD = 8  # seed scenes built before a worker asks for them

Progress = Callable[[int, int], None]


class Campaign:
    """A ranking under way: what is listed, what has run, what failed. Only it writes the folder."""

    def __init__(self, plan: Plan, folder: RankFolder, crew: Crew, progress: Progress | None = None) -> None:
        """Find what an earlier, interrupted run of the same ranking has done."""
        self._plan, self._folder, self._crew, self._progress = plan, folder, crew, progress
        self._ends = round_ends(plan.children, plan.first)
        self._starts = [0, *self._ends[:-1]]
        self.listings: dict[str, Listing] = {}
        self.tallies: dict[str, list[Tally]] = {}
        self.failures: dict[str, Failure] = {}
        self._done = self._total = 0
        for name, failure in folder.failures().items():
            if failure.died:  # of the machine, maybe, and not of the seed
                folder.forgive(name)
            else:
                self.failures[name] = failure
        for recording in plan.recordings:
            if (known := folder.listing(recording.name)) is not None:
                self._enter(known)

    @property
    def listed(self) -> list[SeedRef]:
        """All seeds, in the order of the dataset."""
        names = (recording.name for recording in self._plan.recordings)
        return [ref for name in names if name in self.listings for ref in self.listings[name].seeds]

    @property
    def refs(self) -> list[SeedRef]:
        """The seeds that have results, in the order of the dataset."""
        return [ref for ref in self.listed if self.tallies.get(ref.seed)]

    def parts(self, ref: SeedRef) -> list[pa.Table]:
        """The children of a seed, as written."""
        return [self._folder.read(ref, first) for first in self._starts[: len(self.tallies[ref.seed])]]

    def run(self) -> None:
        """Run all rounds, or what is left of them."""
        for number, (first, stop) in enumerate(zip(self._starts, self._ends, strict=True)):
            chosen = None if number == 0 else self._chosen(number)

            def todo(listing: Listing, first: int = first, chosen: set[str] | None = chosen) -> list[SeedRef]:
                return [ref for ref in listing.seeds if self._open(ref, first, chosen)]

            wanted = Wanted(
                seeds=todo, first=first, stop=stop, spare=self._spare, settings=self._plan.settings
            )
            self._begin_round(stop - first, chosen, first)
            for found in self._results(wanted):
                if found.part is None:
                    self._fail(Failure.of(found.order.ref, found.reason, died=found.died))
                else:
                    self._folder.append(found.order.ref, found.part)
                    self._count(found.order.ref, found.part.critical, found.part.kept)
                self._tick(stop - first)

    def look_at(self, refs: Sequence[SeedRef], children: int) -> Iterator[Outcome]:
        """Run the first children of some seeds again, with all their tracks; nothing is written."""
        names = {ref.seed for ref in refs}
        wanted = Wanted(
            seeds=lambda listing: [ref for ref in listing.seeds if ref.seed in names],
            first=0,
            stop=children,
            spare=lambda ref: children,
            settings=dataclasses.replace(self._plan.settings, keep="all"),
        )
        items = cut(self._plan, self.listings, wanted)
        yield from self._crew.run(item for item in items if isinstance(item, Order))

    def _results(self, wanted: Wanted) -> Iterator[Outcome]:
        known = {name: listing for name, listing in self.listings.items() if listing.failure is None}
        items = read_ahead(cut(self._plan, known, wanted), _AHEAD)
        try:
            yield from self._crew.run(self._orders(items, wanted.stop - wanted.first))
        finally:
            items.close()  # ends the thread, wherever the crew has stopped

    def _orders(self, items: Iterator[Listing | Failure | Order], children: int) -> Iterator[Order]:
        """The orders among the items; the others are entered as they come by."""
        for item in items:
            if isinstance(item, Order):
                yield item
            elif isinstance(item, Listing):
                if item.failure is None:  # what cannot be read is tried again by the next run
                    self._folder.save_listing(item)
                self._enter(item)
                self._expect(children)
            else:
                self._fail(item)
                self._tick(children)

    def _chosen(self, number: int) -> set[str]:
        seed = self._plan.settings.seed
        return {r.seed for r in undecided(self.listed, self.tallies, number, top=self._plan.top, seed=seed)}

    def _open(self, ref: SeedRef, first: int, chosen: set[str] | None) -> bool:
        """Whether a round has still to run a seed."""
        if chosen is not None and ref.seed not in chosen:
            return False
        return ref.seed not in self.failures and not self._folder.has(ref, first)

    def _spare(self, ref: SeedRef) -> int:
        return KEEP_MOST - sum(tally.kept for tally in self.tallies.get(ref.seed, ()))

    def _enter(self, listing: Listing) -> None:
        """Enter the seeds of a recording, and what is there of them."""
        self.listings[listing.recording] = listing
        limits = dict(self._plan.settings.thresholds)
        for ref in listing.seeds:
            for first in self._starts:
                if not self._folder.has(ref, first):
                    break
                table = self._folder.read(ref, first)
                values = np.stack([column_of(table, name) for name in COLUMNS], axis=-1)
                critical = critical_by(values, ~np.isnan(values), limits)
                self._count(ref, critical, np.asarray(table["kept"], dtype=bool))

    def _count(self, ref: SeedRef, critical: BoolArray, kept: BoolArray) -> None:
        tally = Tally(
            children=len(critical),
            critical=critical.sum(axis=0, dtype=np.int64),
            kept=int(kept.sum()),
        )
        self.tallies.setdefault(ref.seed, []).append(tally)

    def _fail(self, failure: Failure) -> None:
        self.failures[failure.seed] = failure
        self._folder.fail(failure)

    def _begin_round(self, children: int, chosen: set[str] | None, first: int) -> None:
        self._done = sum(tally.children for tallies in self.tallies.values() for tally in tallies)
        if chosen is None:
            self._expect(children)
        else:
            open_ = sum(self._open(ref, first, chosen) for ref in self.listed)
            self._total = self._done + open_ * children
        self._tick(0)

    def _expect(self, children: int) -> None:
        """The first round's total: recordings that nobody has looked at hold as many seeds as the others."""
        sizes = [len(listing.seeds) for listing in self.listings.values()]
        mean = sum(sizes) / len(sizes) if sizes else 1.0
        unknown = len(self._plan.recordings) - len(sizes)
        self._total = max(round((sum(sizes) + unknown * mean) * children), self._done)

    def _tick(self, children: int) -> None:
        self._done += children
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._done))


def column_of(table: pa.Table, name: str) -> np.ndarray:
    """(C,) a metric column; NaN where undefined."""
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)
