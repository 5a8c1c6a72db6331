"""Rounds of a ranking: which moments get how many futures, and the scores so far."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import closing

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.progress import Progress
from scex_sumo.converters.registries import Recording
from scex_sumo.studies.moments.cut import Item, moment_tasks, read_ahead
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef
from scex_sumo.studies.moments.run import MomentTask
from scex_sumo.studies.moments.workers import MomentWorkers
from scex_sumo.studies.rank.exact import ExactScore
from scex_sumo.studies.rank.futures import MAX_KEPT, RankFolder, RankTask
from scex_sumo.studies.rank.places import Tally, mean_score, rounds, undecided
from scex_sumo.studies.rank.scores import INJURIES, RankSettings, pairs_of, score_of

_AHEAD = 8  # seed scenes built before a worker asks for them


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
        self._rounds = rounds(settings)
        self.listings: dict[str, Listing] = {}
        self.unreadable: dict[str, Failure] = {}
        self.tallies: dict[str, list[Tally]] = {}
        self.failures: dict[str, Failure] = {}
        self._drawn: dict[str, list[pa.Table]] = {}  # models and critical pairs so far
        self._done = self._total = 0
        for name, failure in folder.failures().items():
            if failure.died:  # of the machine, maybe, and not of the moment
                folder.clear_failure(name)
            else:
                self.failures[name] = failure
        for recording in recordings:
            if (listing := folder.listing(recording.name)) is not None:
                self.listings[recording.name] = listing

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
        """Read the futures of a moment."""
        spans = [span for span in self._rounds[: len(self.tallies[ref.moment])] if span]
        return [self._folder.read(ref, span) for span in spans]

    def run(self) -> None:
        """Run all rounds, or what is missing of them."""
        for number, span in enumerate(self._rounds):
            chosen = None if number == 0 else self._chosen(number)
            self._count_kept(self.listed, span, chosen)
            self._begin_round(span, chosen)
            recordings = self.recordings if chosen is None else self._readable()
            # Closed wherever the workers stop: that ends the thread.
            with closing(read_ahead(self._cut(recordings, span, chosen), _AHEAD)) as items:
                for task, result in self._workers.run(self._tasks(items, _cost(span))):
                    if isinstance(result, Failure):
                        self._fail(result)
                    elif isinstance(result, ExactScore):
                        self._folder.save_exact(task.ref, result)
                        self._count(task.ref, exact=result)
                    else:
                        self._folder.append(task.ref, result)
                        self._count(task.ref, result.futures)
                    self._tick(_cost(span))

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Yield tasks that run moments once more, with all their futures."""
        names = {ref.moment for ref in refs}
        items = moment_tasks(
            self._readable(),
            self.listings,
            self.settings,
            range(self.settings.futures),
            wanted=lambda listing: [ref for ref in listing.moments if ref.moment in names],
        )
        for task in (item for item in items if isinstance(item, MomentTask)):
            yield dataclasses.replace(task, futures=range(self.drawn(task.ref)))

    def drawn(self, ref: MomentRef) -> int:
        """Return the number of futures of a moment."""
        return sum(len(part) for part in self._drawn[ref.moment])

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

    def _tasks(self, items: Iterator[Item], futures: int) -> Iterator[RankTask]:
        for item in items:
            if isinstance(item, MomentTask):
                kept = sum(tally.kept for tally in self.tallies.get(item.ref.moment, ()))
                drawn = None if item.futures else self._pairs(item.ref)
                yield RankTask.of(item, spare=MAX_KEPT - kept, drawn=drawn)
            elif isinstance(item, Listing):
                self._folder.save_listing(item)
                self.listings[item.recording] = item
                self._count_kept(item.moments, self._rounds[0], None)
                self._expect(futures)
            elif item.time_s is None:
                self.unreadable[item.recording] = item
                self._expect(futures)
            else:
                self._fail(item)
                self._tick(futures)

    def _chosen(self, number: int) -> set[str]:
        top, seed = self.settings.top, self.settings.run.seed
        return {ref.moment for ref in undecided(self.listed, self.tallies, number, top=top, seed=seed)}

    def _open(self, ref: MomentRef, span: range, chosen: set[str] | None) -> bool:
        if chosen is not None and ref.moment not in chosen:
            return False
        return ref.moment not in self.failures and not self._has(ref, span)

    def _has(self, ref: MomentRef, span: range) -> bool:
        return self._folder.has(ref, span) if span else self._folder.exact(ref) is not None

    def _count_kept(self, refs: Sequence[MomentRef], span: range, chosen: set[str] | None) -> None:
        """Count the results of a round that an earlier, interrupted run kept, if the round needs them."""
        for ref in (ref for ref in refs if self._has(ref, span)):
            if chosen is not None and ref.moment not in chosen:
                self._folder.drop(ref, span)
            elif span:
                self._count(ref, self._folder.read(ref, span))
            else:
                self._count(ref, exact=self._folder.exact(ref))

    def _pairs(self, ref: MomentRef) -> list[IntArray]:
        return [rows for part in self._drawn[ref.moment] for rows in pairs_of(part)]

    def _count(
        self, ref: MomentRef, futures: pa.Table | None = None, exact: ExactScore | None = None
    ) -> None:
        tallies, parts = self.tallies.setdefault(ref.moment, []), self._drawn.setdefault(ref.moment, [])
        kept = 0
        if futures is not None:
            parts.append(futures.select(["model", "critical_pairs"]))
            kept = pc.sum(futures["kept"]).as_py()
        exact = exact or (tallies[-1].exact if tallies else None)
        models = [row for part in parts for row in part["model"].to_pylist()]
        scores, mean = score_of(self._pairs(ref), self.settings.by), 0.0
        if exact is not None:
            scores, mean = scores - exact.predicted[: len(scores)], exact.mean
        unit = INJURIES if self.settings.by == "severity" else 1.0
        score, error = mean_score(scores, self.settings.intervals(models), unit)
        count = 0 if futures is None else len(futures)
        tallies.append(Tally(futures=count, score=mean + score, error=error, kept=kept, exact=exact))

    def _fail(self, failure: Failure) -> None:
        self.failures[failure.moment] = failure
        self._folder.fail(failure)

    def _begin_round(self, span: range, chosen: set[str] | None) -> None:
        self._done = sum(tally.futures for tallies in self.tallies.values() for tally in tallies)
        if chosen is None:
            self._expect(len(span))
        else:
            self._total = self._done + _cost(span) * sum(self._open(ref, span, chosen) for ref in self.listed)
        self._tick(0)

    def _expect(self, futures: int) -> None:
        known = len(self.listings) + len(self.unreadable)
        moments = sum(len(listing.moments) for listing in self.listings.values())
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        self._total = max(round(expected * futures), self._done)

    def _tick(self, futures: int) -> None:
        self._done += futures
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._done))


def _cost(span: range) -> int:
    """Return the futures of a moment in a round; where tables are searched, at most."""
    return len(span) or 2 * span.stop
