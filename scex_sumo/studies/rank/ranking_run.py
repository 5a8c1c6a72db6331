"""Run of a ranking: the pairs of all moments, and their encounters in an order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property

import pyarrow as pa

from scex_sumo.base.progress import Progress
from scex_sumo.converters.registries import Recording
from scex_sumo.studies.moments.cut import Item, moment_tasks, read_ahead
from scex_sumo.studies.moments.encounters import encounters_of
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef
from scex_sumo.studies.moments.run import MomentTask, StudySettings
from scex_sumo.studies.moments.workers import Done, MomentWorkers, Work
from scex_sumo.studies.rank.encounters import BY_PROBABILITY, Order
from scex_sumo.studies.rank.folder import RankFolder

_AHEAD = 8  # seed scenes built before a worker asks for them
_NO_FUTURES = range(0)


class RankingRun:
    """A ranking under way.

    Attributes:
        unreadable: failures by recording; the next run tries these again.
        failures: by moment.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        settings: RankSettings,
        folder: RankFolder,
        workers: MomentWorkers,
        progress: Progress | None = None,
        *,
        order: Order = BY_PROBABILITY,
    ) -> None:
        """Load the results of an earlier, interrupted run of the same ranking; ``order`` is of encounters."""
        self.recordings, self.settings, self.order = recordings, settings, order
        self._folder, self._workers, self._progress = folder, workers, progress
        self.listings: dict[str, Listing] = {}
        self.unreadable: dict[str, Failure] = {}
        self.failures: dict[str, Failure] = {}
        self._done = 0
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
        return [ref for ref in self.listed if self._folder.has(ref)]

    @cached_property
    def pairs(self) -> Sequence[tuple[MomentRef, pa.Table]]:
        """Pairs of all moments, once these have run."""
        return [(ref, self._folder.pairs(ref)) for ref in self.refs]

    def named_pairs(self) -> Iterator[tuple[str, pa.Table]]:
        """Yield the pairs of all moments by their names."""
        return ((ref.moment, table) for ref, table in self.pairs)

    @cached_property
    def encounters(self) -> pa.Table:
        """Encounters of all moments in their order, without what futures say."""
        return self.order.ranked(encounters_of(self.pairs, self.settings.every))

    def run(self) -> None:
        """Run all moments, or what is missing of them."""
        self._done = sum(not self._is_open(ref) for ref in self.listed)
        self._tick()
        items = moment_tasks(
            self.recordings,
            dict(self.listings),
            self.settings,
            _NO_FUTURES,
            wanted=lambda listing: [ref for ref in listing.moments if self._is_open(ref)],
        )
        # Closed wherever the workers stop: that ends the thread.
        with closing(read_ahead(items, _AHEAD)) as ahead:
            for task, result in self._workers.run(self._tasks(ahead)):
                if isinstance(result, Failure):
                    self._fail(result)
                else:
                    self._folder.save(task.ref, result)
                    self._done += 1
                self._tick()

    def run_again(self, tasks: Iterable[MomentTask], work: Work) -> Iterator[Done]:
        """Let the workers do something else with moments; see `MomentWorkers.run`."""
        return self._workers.run(tasks, work)

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Yield tasks that run the futures of moments."""
        names = {ref.moment for ref in refs}
        items = moment_tasks(
            [recording for recording in self.recordings if recording.name in self.listings],
            self.listings,
            self.settings,
            range(self.settings.futures),
            wanted=lambda listing: [ref for ref in listing.moments if ref.moment in names],
        )
        return (item for item in items if isinstance(item, MomentTask))

    def recording(self, ref: MomentRef) -> Recording:
        """Return the recording of a moment."""
        return next(one for one in self.recordings if one.name == ref.recording)

    def _tasks(self, items: Iterator[Item]) -> Iterator[MomentTask]:
        for item in items:
            if isinstance(item, MomentTask):
                yield item
                continue
            if isinstance(item, Listing):
                self._folder.save_listing(item)
                self.listings[item.recording] = item
            elif item.time_s is None:
                self.unreadable[item.recording] = item
            else:
                self._fail(item)
            self._tick()

    def _is_open(self, ref: MomentRef) -> bool:
        return ref.moment not in self.failures and not self._folder.has(ref)

    def _fail(self, failure: Failure) -> None:
        self._done += 1
        self.failures[failure.moment] = failure
        self._folder.fail(failure)

    def _tick(self) -> None:
        known = len(self.listings) + len(self.unreadable)
        moments = sum(len(listing.moments) for listing in self.listings.values())
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        if self._progress is not None:
            self._progress(self._done, max(round(expected), self._done))


@dataclass(frozen=True, kw_only=True)
class RankSettings(StudySettings):
    """Settings of a ranking; ``run.futures`` are those of the moments on the page.

    Attributes:
        top: encounters on the page.
    """

    top: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_positive("top")
