"""Tasks of a ranking: recordings loaded one after the other, ahead, and cut into moments for the workers."""

from __future__ import annotations

import dataclasses
import functools
import queue
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import TypeVar

from scex_sumo.converters.datasets.recordings import (
    LoadedRecording,
    Recording,
    load_recording,
    recording_moments,
    seed_at,
)
from scex_sumo.converters.moments.moments import Moment
from scex_sumo.errors import reason_of
from scex_sumo.ranking.moments import Failure, Listing, MomentRef, list_moments, unreadable
from scex_sumo.ranking.run_moment import MomentTask, pack_road
from scex_sumo.ranking.settings import RankSettings

T = TypeVar("T")

_LOOK_S = 0.1  # how often a waiting thread looks whether it is still wanted


def moment_tasks(
    recordings: Sequence[Recording],
    listings: Mapping[str, Listing],
    settings: RankSettings,
    children: range,
    *,
    wanted: Callable[[Listing], Sequence[MomentRef]],
    spare: Callable[[MomentRef], int],
    choose: Callable[[LoadedRecording], Sequence[Moment]] | None = None,
) -> Iterator[Listing | Failure | MomentTask]:
    """Tasks of all moments that are wanted; what is wrong with one stops none of the others.

    Args:
        recordings: the dataset, or some of it.
        listings: by recording, those looked at before; recordings of which nothing is wanted are not loaded.
        settings: those of the ranking.
        children: numbers of the children to run.
        wanted: the moments of a recording that shall run.
        spare: how many more children of a moment may have their tracks kept.
        choose: the moments of a recording that has no listing; None takes one every so often.

    Yields:
        The listing of each recording that had none, then its tasks; failures in their place.
    """
    for recording in recordings:
        listing = listings.get(recording.name)
        todo = () if listing is None else wanted(listing)
        if listing is not None and not todo:
            continue
        try:
            loaded = load_recording(recording)
            road = pack_road(loaded.road)
            if listing is None:
                every = functools.partial(recording_moments, every_s=settings.every)
                moments = (choose or every)(loaded)
                listing = list_moments(recording, moments, min_vehicles=settings.min_vehicles)
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
            yield MomentTask(
                ref=ref,
                scene=dataclasses.replace(scene, road=None),
                road=road,
                children=children,
                spare=spare(ref),
                settings=settings,
            )


def read_ahead(items: Iterator[T], size: int) -> Generator[T, None, None]:
    """The same items in the same order, up to ``size`` of them made ahead in a thread.

    An error of the items is raised where it would have come. Closing the result ends the thread after the
    item that it is at.
    """
    buffer: queue.Queue[tuple[T] | BaseException | None] = queue.Queue(maxsize=size)
    unwanted = threading.Event()

    def put(item: tuple[T] | BaseException | None) -> None:
        while not unwanted.is_set():
            try:
                return buffer.put(item, timeout=_LOOK_S)
            except queue.Full:
                continue

    def work() -> None:
        try:
            for item in items:
                put((item,))
                if unwanted.is_set():
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
        unwanted.set()
