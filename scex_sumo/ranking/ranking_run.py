"""Ranking under way: which moments get how many children in which round, and what is known of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, IntArray
from scex_sumo.converters.datasets.recordings import Recording
from scex_sumo.ranking.folder import RankFolder, pairs_of
from scex_sumo.ranking.moments import Failure, Listing, MomentRef
from scex_sumo.ranking.places import Tally, mean_score, round_ends, undecided
from scex_sumo.ranking.run_moment import KEEP_MOST, MomentTask, score_of
from scex_sumo.ranking.settings import RankSettings
from scex_sumo.ranking.tasks import moment_tasks, read_ahead
from scex_sumo.ranking.workers import MomentWorkers

_AHEAD = 8  # seed scenes built before a worker asks for them

Progress = Callable[[int, int], None]


class RankingRun:
    """A ranking under way: what is listed, what has run, what failed. Only it writes the folder.

    Attributes:
        recordings: the dataset.
        settings: what decides on the values.
        listings: by recording, its moments.
        unreadable: by recording, why it has none; the next run tries it again.
        tallies: by moment, what each round found.
        failures: by moment.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        settings: RankSettings,
        folder: RankFolder,
        workers: MomentWorkers,
        progress: Progress | None = None,
    ) -> None:
        """Find what an earlier, interrupted run of the same ranking has done."""
        self.recordings, self.settings = recordings, settings
        self._folder, self._workers, self._progress = folder, workers, progress
        self._ends = round_ends(settings.children, settings.first)
        self._starts = [0, *self._ends[:-1]]
        self.listings: dict[str, Listing] = {}
        self.unreadable: dict[str, Failure] = {}
        self.tallies: dict[str, list[Tally]] = {}
        self.failures: dict[str, Failure] = {}
        self._scores: dict[str, tuple[list[Sequence[str]], list[float]]] = {}  # drivers and scores so far
        self._done = self._total = 0
        for name, failure in folder.failures().items():
            if failure.died:  # of the machine, maybe, and not of the moment
                folder.clear_failure(name)
            else:
                self.failures[name] = failure
        for recording in recordings:
            if (known := folder.listing(recording.name)) is not None:
                self._enter(known)

    @property
    def listed(self) -> list[MomentRef]:
        """All moments, in the order of the dataset."""
        listings = (self.listings.get(recording.name) for recording in self.recordings)
        return [ref for listing in listings if listing is not None for ref in listing.moments]

    @property
    def refs(self) -> list[MomentRef]:
        """The moments that have results, in the order of the dataset."""
        return [ref for ref in self.listed if self.tallies.get(ref.moment)]

    def parts(self, ref: MomentRef) -> list[pa.Table]:
        """The children of a moment, as written."""
        return [self._folder.read(ref, first) for first in self._starts[: len(self.tallies[ref.moment])]]

    def run(self) -> None:
        """Run all rounds, or what is left of them."""
        for number, span in enumerate(map(range, self._starts, self._ends)):
            chosen = None if number == 0 else self._chosen(number)
            self._begin_round(span, chosen)
            recordings = self.recordings if chosen is None else self._readable()
            items = read_ahead(self._cut(recordings, span, chosen), _AHEAD)
            try:
                for task, found in self._workers.run(self._tasks(items, len(span))):
                    if isinstance(found, Failure):
                        self._fail(found)
                    else:
                        self._folder.append(task.ref, found)
                        self._count(task.ref, found.models, found.pairs, found.kept)
                    self._tick(len(span))
            finally:
                items.close()  # ends the thread, wherever the workers have stopped

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Some moments with all children that they have been given, as tasks that may be run once more."""
        names = {ref.moment for ref in refs}
        items = moment_tasks(
            self._readable(),
            self.listings,
            self.settings,
            range(self.settings.children),
            wanted=lambda listing: [ref for ref in listing.moments if ref.moment in names],
            spare=lambda ref: 0,
        )
        for task in (item for item in items if isinstance(item, MomentTask)):
            yield dataclasses.replace(task, children=range(self.tallies[task.ref.moment][-1].children))

    def _readable(self) -> list[Recording]:
        return [recording for recording in self.recordings if recording.name in self.listings]

    def _cut(
        self, recordings: Sequence[Recording], span: range, chosen: set[str] | None
    ) -> Iterator[Listing | Failure | MomentTask]:
        return moment_tasks(
            recordings,
            dict(self.listings),
            self.settings,
            span,
            wanted=lambda listing: [ref for ref in listing.moments if self._open(ref, span, chosen)],
            spare=lambda ref: KEEP_MOST - sum(tally.kept for tally in self.tallies.get(ref.moment, ())),
        )

    def _tasks(self, items: Iterator[Listing | Failure | MomentTask], children: int) -> Iterator[MomentTask]:
        """The tasks among the items; the others are entered as they come by."""
        for item in items:
            if isinstance(item, MomentTask):
                yield item
            elif isinstance(item, Listing):
                self._folder.save_listing(item)
                self._enter(item)
                self._expect(children)
            elif item.time_s is None:
                self.unreadable[item.recording] = item
                self._expect(children)
            else:
                self._fail(item)
                self._tick(children)

    def _chosen(self, number: int) -> set[str]:
        top, seed = self.settings.top, self.settings.seed
        return {ref.moment for ref in undecided(self.listed, self.tallies, number, top=top, seed=seed)}

    def _open(self, ref: MomentRef, span: range, chosen: set[str] | None) -> bool:
        """Whether a round has still to run a moment."""
        if chosen is not None and ref.moment not in chosen:
            return False
        return ref.moment not in self.failures and not self._folder.has(ref, span.start)

    def _enter(self, listing: Listing) -> None:
        """Enter the moments of a recording, and what is there of them."""
        self.listings[listing.recording] = listing
        for ref in listing.moments:
            for first in self._starts:
                if not self._folder.has(ref, first):
                    break
                table = self._folder.read(ref, first)
                kept = np.asarray(table["kept"], dtype=bool)
                self._count(ref, table["model"].to_pylist(), pairs_of(table), kept)

    def _count(
        self,
        ref: MomentRef,
        models: Sequence[Sequence[str]],
        pairs: Sequence[IntArray],
        kept: BoolArray,
    ) -> None:
        """Enter what a round found of a moment."""
        drivers, scores = self._scores.setdefault(ref.moment, ([], []))
        drivers.extend(models)
        scores.extend(score_of(pairs).tolist())
        score, error = mean_score(np.array(scores), self.settings.intervals(drivers))
        tally = Tally(children=len(kept), score=score, error=error, kept=int(kept.sum()))
        self.tallies.setdefault(ref.moment, []).append(tally)

    def _fail(self, failure: Failure) -> None:
        self.failures[failure.moment] = failure
        self._folder.fail(failure)

    def _begin_round(self, span: range, chosen: set[str] | None) -> None:
        self._done = sum(tally.children for tallies in self.tallies.values() for tally in tallies)
        if chosen is None:
            self._expect(len(span))
        else:
            self._total = self._done + len(span) * sum(self._open(ref, span, chosen) for ref in self.listed)
        self._tick(0)

    def _expect(self, children: int) -> None:
        """The first round's total: recordings not looked at yet hold as many moments as the others."""
        known = len(self.listings) + len(self.unreadable)
        moments = sum(len(listing.moments) for listing in self.listings.values())
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        self._total = max(round(expected * children), self._done)

    def _tick(self, children: int) -> None:
        self._done += children
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._done))
