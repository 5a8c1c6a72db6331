"""Cut recordings into moments: one recording after the other, ahead of the workers."""

from __future__ import annotations

import dataclasses
import queue
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import TypeAlias, TypeVar

from scex_sumo.base.errors import one_line, reason_of
from scex_sumo.converters.datasets.moment import Moment
from scex_sumo.converters.registries import Recording
from scex_sumo.evaluation.recordings import LoadedRecording, load_recording, recording_moments, seed_at
from scex_sumo.studies.moments.folder import Failure, Listing, MomentRef, moment_name, plain
from scex_sumo.studies.moments.run import MomentTask, StudySettings, pack_road

T = TypeVar("T")
Item: TypeAlias = Listing | Failure | MomentTask
Choose: TypeAlias = Callable[[LoadedRecording], Sequence[Moment]]

MIN_VEHICLES = 2
_POLL_S = 0.1  # how often a waiting thread checks whether it is still needed


def moment_tasks(
    recordings: Sequence[Recording],
    listings: Mapping[str, Listing],
    settings: StudySettings,
    *,
    wanted: Callable[[Listing], Sequence[MomentRef]],
    choose: Choose | None = None,
) -> Iterator[Item]:
    """Yield the listing of each recording that had none, then its tasks; failures in their place.

    Args:
        listings: by recording; a recording without wanted moments is not loaded.
        wanted: the moments of a recording that shall run.
        choose: the moments of a recording without a listing.
    """
    for recording in recordings:
        listing = listings.get(recording.name)
        todo = () if listing is None else wanted(listing)
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
                yield listing
                todo = wanted(listing)
        except Exception as error:
            if listing is None:
                yield unreadable(recording, reason_of(error))
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
    """List the moments of a recording that have two vehicles.

    In cases all vehicles count, else those that move and are recorded from 1 s before to 3 s after.
    """
    refs = [
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
    ]
    return Listing(recording=recording.name, moments=tuple(refs))


def unreadable(recording: Recording, reason: str) -> Failure:
    """Return the failure of a recording that cannot be read."""
    name, location = plain(recording.name), plain(recording.site)
    return Failure(moment=name, location=location, recording=recording.name, reason=one_line(reason))


def read_ahead(items: Iterator[T], size: int) -> Generator[T, None, None]:
    """Yield the same items; a thread makes up to ``size`` of them ahead.

    Closing the generator ends the thread after its present item.
    """
    buffer: queue.Queue[tuple[T] | BaseException | None] = queue.Queue(maxsize=size)
    closed = threading.Event()

    def put(item: tuple[T] | BaseException | None) -> None:
        while not closed.is_set():
            try:
                return buffer.put(item, timeout=_POLL_S)
            except queue.Full:
                continue

    def work() -> None:
        try:
            for item in items:
                put((item,))
                if closed.is_set():
                    return
            put(None)
        except BaseException as error:
            put(error)

    threading.Thread(target=work, name="read ahead", daemon=True).start()
    try:
        while (got := buffer.get()) is not None:
            if isinstance(got, BaseException):
                raise got
            yield got[0]
    finally:
        closed.set()
