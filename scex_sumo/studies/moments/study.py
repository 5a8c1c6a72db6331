"""Run of a study in its folder: all moments of its recordings, or what is missing of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing

from scex_sumo.base.progress import Progress
from scex_sumo.converters.registries import Recording
from scex_sumo.studies.moments.cut import Choose, Item, moment_tasks, read_ahead
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef, StudyFolder
from scex_sumo.studies.moments.run import MomentTask, StudySettings
from scex_sumo.studies.moments.workers import MomentWorkers, Work

_AHEAD = 8  # seed scenes built before a worker asks for them


class MomentRun:
    """A study under way: its moments run, once each, in any order.

    Attributes:
        unreadable: failures by recording; the next run tries these again.
        failures: by moment.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        settings: StudySettings,
        folder: StudyFolder,
        workers: MomentWorkers,
        progress: Progress | None = None,
    ) -> None:
        """Load what an earlier, interrupted run of the same study found."""
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

    def run(self, work: Work, choose: Choose | None = None) -> None:
        """Run all moments, or what is missing of them; keep the results of ``work`` in the folder.

        ``choose`` is as of `moment_tasks`.
        """
        self._done = sum(not self._is_open(ref) for ref in self.listed)
        self._tick()
        items = moment_tasks(
            self.recordings,
            dict(self.listings),
            self.settings,
            wanted=lambda listing: [ref for ref in listing.moments if self._is_open(ref)],
            choose=choose,
        )
        # Closed wherever the workers stop: that ends the thread.
        with closing(read_ahead(items, _AHEAD)) as ahead:
            for task, result in self.workers.run(work, self._tasks(ahead)):
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
