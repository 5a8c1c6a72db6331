"""Rounds of a ranking: which moments get how many children, and the scores so far."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.converters.datasets.recordings import Recording
from scex_sumo.studies.moments.cut import Item, moment_tasks, read_ahead
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef
from scex_sumo.studies.moments.run import MomentTask
from scex_sumo.studies.moments.workers import MomentWorkers
from scex_sumo.studies.rank.children import MAX_KEPT, RankTask, pairs_of, score_of
from scex_sumo.studies.rank.folder import RankFolder
from scex_sumo.studies.rank.places import Tally, mean_score, round_ends, undecided
from scex_sumo.studies.rank.settings import RankSettings

_AHEAD = 8  # seed scenes built before a worker asks for them

Progress = Callable[[int, int], None]


class RankingRun:
    """A ranking under way.

    Attributes:
        unreadable: failures by recording; the next run tries these again.
        tallies: results of the rounds by moment.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        settings: RankSettings,
        folder: RankFolder,
        workers: MomentWorkers,
        progress: Progress | None = None,
    ) -> None:
        """Load the results of an earlier, interrupted run of the same ranking."""
        self.recordings, self.settings = recordings, settings
        self._folder, self._workers, self._progress = folder, workers, progress
        self._ends = round_ends(settings.children, settings.first)
        self._starts = [0, *self._ends[:-1]]
        self.listings: dict[str, Listing] = {}
        self.unreadable: dict[str, Failure] = {}
        self.tallies: dict[str, list[Tally]] = {}
        self.failures: dict[str, Failure] = {}
        self._scores: dict[str, tuple[list[Sequence[str]], list[float]]] = {}  # models and scores so far
        self._done = self._total = 0
        for name, failure in folder.failures().items():
            if failure.died:  # of the machine, maybe, and not of the moment
                folder.clear_failure(name)
            else:
                self.failures[name] = failure
        for recording in recordings:
            if (listing := folder.listing(recording.name)) is not None:
                self._enter(listing)

    @property
    def listed(self) -> list[MomentRef]:
        """All moments, in the order of the dataset."""
        listings = (self.listings.get(recording.name) for recording in self.recordings)
        return [ref for listing in listings if listing is not None for ref in listing.moments]

    @property
    def refs(self) -> list[MomentRef]:
        """All moments with results, in the order of the dataset."""
        return [ref for ref in self.listed if self.tallies.get(ref.moment)]

    def parts(self, ref: MomentRef) -> list[pa.Table]:
        """Read the children of a moment."""
        return [self._folder.read(ref, first) for first in self._starts[: len(self.tallies[ref.moment])]]

    def run(self) -> None:
        """Run all rounds that have not run."""
        for number, span in enumerate(map(range, self._starts, self._ends)):
            chosen = None if number == 0 else self._chosen(number)
            self._begin_round(span, chosen)
            recordings = self.recordings if chosen is None else self._readable()
            items = read_ahead(self._cut(recordings, span, chosen), _AHEAD)
            try:
                for task, result in self._workers.run(self._tasks(items, len(span))):
                    if isinstance(result, Failure):
                        self._fail(result)
                    else:
                        self._folder.append(task.ref, result)
                        self._count(task.ref, result.children)
                    self._tick(len(span))
            finally:
                items.close()  # ends the thread, wherever the workers have stopped

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Yield tasks that run moments once more, with all their children."""
        names = {ref.moment for ref in refs}
        items = moment_tasks(
            self._readable(),
            self.listings,
            self.settings,
            range(self.settings.children),
            wanted=lambda listing: [ref for ref in listing.moments if ref.moment in names],
        )
        for task in (item for item in items if isinstance(item, MomentTask)):
            yield dataclasses.replace(task, children=range(self.tallies[task.ref.moment][-1].children))

    def _readable(self) -> list[Recording]:
        return [recording for recording in self.recordings if recording.name in self.listings]

    def _cut(self, recordings: Sequence[Recording], span: range, chosen: set[str] | None) -> Iterator[Item]:
        return moment_tasks(
            recordings,
            dict(self.listings),
            self.settings,
            span,
            wanted=lambda listing: [ref for ref in listing.moments if self._open(ref, span, chosen)],
        )

    def _tasks(self, items: Iterator[Item], children: int) -> Iterator[RankTask]:
        for item in items:
            if isinstance(item, MomentTask):
                kept = sum(tally.kept for tally in self.tallies.get(item.ref.moment, ()))
                yield RankTask.of(item, spare=MAX_KEPT - kept)
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
        top, seed = self.settings.top, self.settings.run.seed
        return {ref.moment for ref in undecided(self.listed, self.tallies, number, top=top, seed=seed)}

    def _open(self, ref: MomentRef, span: range, chosen: set[str] | None) -> bool:
        if chosen is not None and ref.moment not in chosen:
            return False
        return ref.moment not in self.failures and not self._folder.has(ref, span.start)

    def _enter(self, listing: Listing) -> None:
        self.listings[listing.recording] = listing
        for ref in listing.moments:
            for first in self._starts:
                if not self._folder.has(ref, first):
                    break
                self._count(ref, self._folder.read(ref, first))

    def _count(self, ref: MomentRef, children: pa.Table) -> None:
        models, scores = self._scores.setdefault(ref.moment, ([], []))
        models.extend(children["model"].to_pylist())
        scores.extend(score_of(pairs_of(children), self.settings.by).tolist())
        score, error = mean_score(np.array(scores), self.settings.intervals(models))
        kept = pc.sum(children["kept"]).as_py()
        tally = Tally(children=len(children), score=score, error=error, kept=kept)
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
        known = len(self.listings) + len(self.unreadable)
        moments = sum(len(listing.moments) for listing in self.listings.values())
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        self._total = max(round(expected * children), self._done)

    def _tick(self, children: int) -> None:
        self._done += children
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._done))
