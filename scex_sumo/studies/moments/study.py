"""Run of a study: its recordings cut into moments, ahead of the workers; these run, or what is missing."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from typing import TypeAlias, TypeVar, cast

from scex_sumo.base.errors import one_line, reason_of
from scex_sumo.base.progress import Progress
from scex_sumo.converters.datasets.moment import Moment
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording, recording_moments, seed_at
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef, StudyFolder, moment_name, plain
from scex_sumo.studies.moments.run import MomentTask, MomentWorkers, StudySettings, Work, pack_road

T = TypeVar("T")
Item: TypeAlias = tuple[str, Listing] | Failure | MomentTask
Choose: TypeAlias = Callable[[LoadedRecording], Sequence[Moment]]

MIN_VEHICLES = 2
_AHEAD = 8  # seed scenes built before a worker asks for them


def moment_tasks(
    recordings: Sequence[Recording],
    listings: Mapping[str, Listing],
    settings: StudySettings,
    *,
    wanted: Callable[[MomentRef], bool],
    choose: Choose | None = None,
) -> Iterator[Item]:
    """Yield the listing of each recording that had none, then its wanted tasks; failures in their place.

    A recording without wanted moments is not loaded; ``choose`` gives the moments of one without a listing.
    """
    for recording in recordings:
        listing = listings.get(recording.name)
        todo = [*filter(wanted, listing or ())]
        if listing is not None and not todo:
            continue
        try:
            loaded = load_recording(recording)
            road = pack_road(loaded.road)
            if loaded.road.net is not None:  # studies have no drivers that see the phases of its lights
                netless = dataclasses.replace(loaded.road, net=None)
                loaded = dataclasses.replace(loaded, road=netless)
            if listing is None:
                moments = choose(loaded) if choose else recording_moments(loaded, every_s=settings.every)
                listing = list_moments(recording, moments)
                yield recording.name, listing
                todo = [*filter(wanted, listing)]
        except Exception as error:
            if listing is None:
                name, location = plain(recording.name), plain(recording.site)
                reason = one_line(reason_of(error))
                yield Failure(moment=name, location=location, recording=recording.name, reason=reason)
            yield from (Failure.of(ref, reason_of(error)) for ref in todo)
            continue
        for ref in todo:
            try:
                scene = seed_at(loaded, ref.time_s, case=ref.case or None)
            except Exception as error:
                yield Failure.of(ref, reason_of(error))
                continue
            bare = dataclasses.replace(scene, road=None)
            yield MomentTask(ref=ref, scene=bare, road=road, settings=settings)


def list_moments(recording: Recording, moments: Sequence[Moment]) -> Listing:
    """List moments with two vehicles: in cases any, else moving, recorded from 1 s before to 3 s after."""
    return tuple(
        MomentRef(
            moment=moment_name(recording.name, m.case, m.time_s),
            location=plain(recording.site),
            recording=recording.name,
            case=m.case,
            time_s=m.time_s,
            vehicles=m.vehicles,
        )
        for m in moments
        if (m.vehicles if m.case else m.complete) >= MIN_VEHICLES
    )


def read_ahead(items: Iterator[T], size: int) -> Generator[T, None, None]:
    """Yield the same items; a thread, which ends when this is closed, makes up to ``size`` of them ahead."""
    thread, end = ThreadPoolExecutor(1, thread_name_prefix="read ahead"), object()
    try:
        ahead = deque(thread.submit(next, items, end) for _ in range(size + 1))
        while (item := ahead.popleft().result()) is not end:
            ahead.append(thread.submit(next, items, end))
            yield cast(T, item)
    finally:
        thread.shutdown(wait=False, cancel_futures=True)


class MomentRun:
    """A study under way: its moments run once each.

    The next run tries ``unreadable`` recordings again.
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
        self.unreadable: dict[str, Failure] = {}
        self._done, self.failures = 0, folder.failures()
        for name in [name for name, failure in self.failures.items() if failure.died]:
            del self.failures[name]  # of the machine, maybe, and not of the moment
            folder.clear_failure(name)
        known = {recording.name: folder.listing(recording.name) for recording in recordings}
        self.listings = {name: listing for name, listing in known.items() if listing is not None}

    @property
    def listed(self) -> list[MomentRef]:
        """All moments, in the order of the dataset."""
        listings = (self.listings.get(recording.name) for recording in self.recordings)
        return [ref for listing in listings if listing is not None for ref in listing]

    @property
    def refs(self) -> list[MomentRef]:
        """All moments with results, in the order of the dataset."""
        return [ref for ref in self.listed if self.folder.has(ref)]

    def run(self, work: Work, choose: Choose | None = None) -> None:
        """Run what is missing, keep results of ``work`` in the folder; ``choose`` is as of `moment_tasks`."""
        self._done = sum(not self._is_open(ref) for ref in self.listed)
        self._tick()
        items = moment_tasks(
            self.recordings, dict(self.listings), self.settings, wanted=self._is_open, choose=choose
        )
        # Closed wherever the workers stop: that ends the thread.
        with closing(read_ahead(items, _AHEAD)) as ahead:
            for task, result in self.workers.run_each(work, self._tasks(ahead)):
                if isinstance(result, Failure):
                    self._fail(result)
                else:
                    self.folder.save(task.ref, result)
                    self._done += 1
                self._tick()

    def tasks(self, refs: Sequence[MomentRef]) -> Iterator[MomentTask]:
        """Yield tasks that run the futures of moments."""
        wanted = frozenset(refs)
        items = moment_tasks(
            [recording for recording in self.recordings if recording.name in self.listings],
            self.listings,
            self.settings,
            wanted=wanted.__contains__,
        )
        return (item for item in items if isinstance(item, MomentTask))

    def _tasks(self, items: Iterator[Item]) -> Iterator[MomentTask]:
        for item in items:
            if isinstance(item, MomentTask):
                yield item
                continue
            if isinstance(item, tuple):
                recording, listing = item
                self.folder.save_listing(recording, listing)
                self.listings[recording] = listing
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
        moments = sum(map(len, self.listings.values()))
        expected = moments * len(self.recordings) / known if known else len(self.recordings)
        if self._progress is not None:
            self._progress(self._done, max(round(expected), self._done))
