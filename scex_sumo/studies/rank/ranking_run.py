"""Run of a ranking in its folder: the pairs of all moments, and their encounters in an order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import cached_property

import pyarrow as pa

from scex_sumo.base.progress import Progress
from scex_sumo.converters.registries import Recording
from scex_sumo.decision.moment import FUTURES as HUMAN_FUTURES
from scex_sumo.extrapolation.job import ruled
from scex_sumo.scene import SeedScene
from scex_sumo.studies.moments.cut import Item, moment_tasks, read_ahead
from scex_sumo.studies.moments.encounters import pairs_of_moment
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef, StudyFolder, as_row, from_row
from scex_sumo.studies.moments.run import MomentTask, StudySettings, net_of
from scex_sumo.studies.moments.workers import MomentWorkers

_AHEAD = 8  # seed scenes built before a worker asks for them


class RankingRun:
    """A ranking under way.

    Attributes:
        unreadable: failures by recording; the next run tries these again.
        failures: by moment.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        settings: StudySettings,
        folder: RankFolder,
        workers: MomentWorkers,
        progress: Progress | None = None,
    ) -> None:
        """Load the results of an earlier, interrupted run of the same ranking."""
        self.recordings, self.settings = recordings, settings
        self.workers, self.folder, self._progress = workers, folder, progress
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
    def listed(self) -> list[MomentRef]:
        """All moments, in the order of the dataset."""
        listings = (self.listings.get(recording.name) for recording in self.recordings)
        return [ref for listing in listings if listing is not None for ref in listing.moments]

    @property
    def refs(self) -> list[MomentRef]:
        """All moments with results, in the order of the dataset."""
        return [ref for ref in self.listed if self.folder.has(ref)]

    @cached_property
    def pairs(self) -> Sequence[tuple[MomentRef, pa.Table]]:
        """Pairs of all moments, once these have run."""
        return [(ref, self.folder.pairs(ref)) for ref in self.refs]

    def run(self) -> None:
        """Run all moments, or what is missing of them."""
        self._done = sum(not self._is_open(ref) for ref in self.listed)
        self._tick()
        items = moment_tasks(
            self.recordings,
            dict(self.listings),
            self.settings,
            wanted=lambda listing: [ref for ref in listing.moments if self._is_open(ref)],
        )
        # Closed wherever the workers stop: that ends the thread.
        with closing(read_ahead(items, _AHEAD)) as ahead:
            for task, result in self.workers.run(run_moment, self._tasks(ahead)):
                if isinstance(result, Failure):
                    self._fail(result)
                else:
                    self.folder.save(task.ref, result)
                    self._done += 1
                self._tick()

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Yield tasks that run the futures of moments."""
        names = {ref.moment for ref in refs}
        items = moment_tasks(
            [recording for recording in self.recordings if recording.name in self.listings],
            self.listings,
            self.settings,
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
                self.folder.save_listing(item)
                self.listings[item.recording] = item
            elif item.time_s is None:
                self.unreadable[item.recording] = item
            else:
                self._fail(item)
            self._tick()

    def _is_open(self, ref: MomentRef) -> bool:
        return ref.moment not in self.failures and not self.folder.has(ref)

    def _fail(self, failure: Failure) -> None:
        self._done += 1
        self.failures[failure.moment] = failure
        self.folder.fail(failure)

    def _tick(self) -> None:
        known = len(self.listings) + len(self.unreadable)
        moments = sum(len(listing.moments) for listing in self.listings.values())
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        if self._progress is not None:
            self._progress(self._done, max(round(expected), self._done))


REPORTS = "moments"
"""Folder of the reports of the moments that are shown."""
_PAIRS, _SEEDS = "pairs", "seeds"


def run_moment(task: MomentTask, scene: SeedScene) -> pa.Table:
    """Return the pairs of a moment."""
    scene, net = ruled(scene, net_of(task.road), task.settings.run)
    return pairs_of_moment(scene, net, futures=HUMAN_FUTURES, seed=task.settings.run.seed)


class RankFolder(StudyFolder):
    """Folder of a ranking under way: ``pairs/location=L/seed=S/pairs.parquet``."""

    info, what = "rank.json", "ranking"
    another = "another ranking, of other recordings or with other options"
    evidence = ("ranking.parquet", "ranking.csv", _SEEDS)
    trees, records = (_PAIRS,), (_SEEDS,)
    kept = ("ranking.parquet", "ranking.csv", "moments.parquet", "moments.csv", "ranking.html", REPORTS)

    def listing(self, recording: str) -> Listing | None:
        """Return the moments of a recording; None if it is not listed, or the file is damaged."""
        rows = self._load(_SEEDS, recording)
        refs = None if rows is None else tuple(MomentRef(**from_row(row)) for row in rows)
        return None if refs is None else Listing(recording=recording, moments=refs)

    def save_listing(self, listing: Listing) -> None:
        """Keep the moments of a recording."""
        self._save(_SEEDS, listing.recording, [as_row(ref) for ref in listing.moments])

    def save(self, ref: MomentRef, pairs: pa.Table) -> None:
        """Keep the pairs of a moment, unless they are there."""
        if not self.has(ref):
            # Of so few rows, statistics and schema would be the larger part.
            self._add(ref.moment, {_file(ref): pairs}, write_statistics=False, store_schema=False)

    def pairs(self, ref: MomentRef) -> pa.Table:
        """Read the pairs of a moment."""
        return self._read(ref.moment, _file(ref))


def _file(ref: MomentRef) -> str:
    return f"{_PAIRS}/location={ref.location}/seed={ref.moment}/{_PAIRS}.parquet"
