"""Rounds of a ranking: pairs of all moments, then futures of some, and the scores so far."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from functools import cached_property

import pyarrow as pa
import pyarrow.compute as pc

from scex_sumo.base.arrays import IntArray
from scex_sumo.base.progress import Progress
from scex_sumo.converters.registries import Recording
from scex_sumo.studies.moments.cut import Item, moment_tasks, read_ahead
from scex_sumo.studies.moments.encounters import encounters_of
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef
from scex_sumo.studies.moments.run import MomentTask
from scex_sumo.studies.moments.workers import Done, MomentWorkers, Work
from scex_sumo.studies.rank.encounters import BY_SEVERITY, Order, StressTest, leads
from scex_sumo.studies.rank.exact import ExactScore
from scex_sumo.studies.rank.futures import MAX_KEPT, PAIRS_ROUND, RankFolder, RankTask, is_pairs
from scex_sumo.studies.rank.places import Tally, mean_score, rounds, undecided
from scex_sumo.studies.rank.scores import RankSettings, pairs_of, score_of

_AHEAD = 8  # seed scenes built before a worker asks for them
PAIRS_COST = 32  # futures of a moment that take as long as its pairs, about


class RankingRun:
    """A ranking under way.

    Attributes:
        unreadable: failures by recording; the next run tries these again.
        tallies: results of the rounds of futures by moment.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        settings: RankSettings,
        folder: RankFolder,
        workers: MomentWorkers,
        progress: Progress | None = None,
        *,
        order: Order = BY_SEVERITY,
    ) -> None:
        """Load the results of an earlier, interrupted run of the same ranking; ``order`` is of encounters."""
        self.recordings, self.settings = recordings, settings
        self._folder, self._workers, self._progress = folder, workers, progress
        self._rounds, self.order = rounds(settings), order
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
    def identity(self) -> str:
        """Identity of the ranking, by recordings and options."""
        return self._folder.identity

    @property
    def listed(self) -> list[MomentRef]:
        """All moments, in the order of the dataset."""
        listings = (self.listings.get(recording.name) for recording in self.recordings)
        return [ref for listing in listings if listing is not None for ref in listing.moments]

    @property
    def refs(self) -> list[MomentRef]:
        """All moments with results, in the order of the dataset."""
        return [ref for ref in self.listed if self._folder.has(ref, PAIRS_ROUND)]

    @cached_property
    def pairs(self) -> Sequence[tuple[MomentRef, pa.Table]]:
        """Pairs of all moments, once these have run."""
        return [(ref, self._folder.pairs(ref)) for ref in self.refs]

    @cached_property
    def encounters(self) -> pa.Table:
        """Encounters of all moments in their order, without what futures say."""
        return self.order.ranked(encounters_of(self.pairs, self.settings.every))

    def stress(self) -> dict[str, StressTest]:
        """Return by moment what its futures say about its pairs."""
        some = [ref for ref in self.refs if self.tallies.get(ref.moment)]
        return {r.moment: StressTest.of(self._pairs(r), self.tallies[r.moment][-1].exact) for r in some}

    def parts(self, ref: MomentRef) -> list[pa.Table]:
        """Read the futures of a moment."""
        spans = [span for span in self._rounds[: len(self.tallies.get(ref.moment, ()))] if span]
        return [self._folder.read(ref, span) for span in spans]

    def run(self) -> None:
        """Run all rounds, or what is missing of them."""
        for number, span in enumerate([PAIRS_ROUND, *self._rounds]):
            chosen = None if number < 1 + bool(self.settings.first) else self._chosen(number - 1)
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
                    elif isinstance(result, pa.Table):
                        self._folder.save_pairs(task.ref, result)
                    else:
                        self._folder.append(task.ref, result)
                        self._count(task.ref, result.futures)
                    self._tick(_cost(span))

    def run_again(self, tasks: Iterable[MomentTask], work: Work) -> Iterator[Done]:
        """Let the workers do something else with moments; see `MomentWorkers.run`."""
        return self._workers.run(tasks, work)

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Yield tasks that run moments once more, with all their futures."""
        names = {ref.moment for ref in refs} & self._drawn.keys()  # those of failed ones are not there
        items = moment_tasks(
            self._readable(),
            self.listings,
            self.settings,
            range(self.settings.futures),
            wanted=lambda listing: [ref for ref in listing.moments if ref.moment in names],
        )
        for task in (item for item in items if isinstance(item, MomentTask)):
            yield dataclasses.replace(task, futures=range(self.drawn(task.ref)))

    def recording(self, ref: MomentRef) -> Recording:
        """Return the recording of a moment."""
        return next(one for one in self.recordings if one.name == ref.recording)

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
                drawn = None if item.futures or is_pairs(item.futures) else self._pairs(item.ref)
                yield RankTask.of(item, spare=MAX_KEPT - kept, drawn=drawn)
            elif isinstance(item, Listing):
                self._folder.save_listing(item)
                self.listings[item.recording] = item
                self._expect()
            elif item.time_s is None:
                self.unreadable[item.recording] = item
                self._expect()
            else:
                self._fail(item)
                self._tick(futures)

    def _chosen(self, number: int) -> set[str]:
        top, seed = self.settings.top, self.settings.run.seed
        if not self.settings.first:
            return set(leads(self.encounters)["seed"].slice(0, top).to_pylist())
        return {ref.moment for ref in undecided(self.listed, self.tallies, number, top=top, seed=seed)}

    def _open(self, ref: MomentRef, span: range, chosen: set[str] | None) -> bool:
        if chosen is not None and ref.moment not in chosen:
            return False
        return ref.moment not in self.failures and not self._has(ref, span)

    def _has(self, ref: MomentRef, span: range) -> bool:
        if span or is_pairs(span):
            return self._folder.has(ref, span)
        return self._folder.exact(ref) is not None

    def _count_kept(self, refs: Sequence[MomentRef], span: range, chosen: set[str] | None) -> None:
        """Count the results of a round that an earlier, interrupted run kept, if the round needs them."""
        for ref in (ref for ref in refs if self._has(ref, span)):
            if chosen is not None and ref.moment not in chosen:
                self._folder.drop(ref, span)
            elif span:
                self._count(ref, self._folder.read(ref, span))
            elif not is_pairs(span):
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
        scores, mean = score_of(self._pairs(ref)), 0.0
        if exact is not None:
            scores, mean = scores - exact.predicted[: len(scores)], exact.mean
        score, error = mean_score(scores, self.settings.intervals(models))
        count = 0 if futures is None else len(futures)
        tallies.append(Tally(futures=count, score=mean + score, error=error, kept=kept, exact=exact))

    def _fail(self, failure: Failure) -> None:
        self.failures[failure.moment] = failure
        self._folder.fail(failure)

    def _begin_round(self, span: range, chosen: set[str] | None) -> None:
        self._done = sum(tally.futures for tallies in self.tallies.values() for tally in tallies)
        self._done += PAIRS_COST * len(self.refs)
        if chosen is None:
            self._expect()
        else:
            self._total = self._done + _cost(span) * sum(self._open(ref, span, chosen) for ref in self.listed)
        self._tick(0)

    def _expect(self) -> None:
        known = len(self.listings) + len(self.unreadable)
        moments = sum(len(listing.moments) for listing in self.listings.values())
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        self._total = max(round(expected * (PAIRS_COST + self.settings.first)), self._done)

    def _tick(self, futures: int) -> None:
        self._done += futures
        if self._progress is not None:
            self._progress(self._done, max(self._total, self._done))


def _cost(span: range) -> int:
    """Return the futures of a moment in a round; where tables are searched, at most."""
    return len(span) or 2 * span.stop or PAIRS_COST
