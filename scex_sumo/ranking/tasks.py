"""Recordings become orders: loaded one after the other, cut into seed scenes, packed for workers."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from scex_sumo.converters.datasets.recordings import Recording, load_recording, recording_moments, seed_at
from scex_sumo.ranking.seeds import Failure, Listing, SeedRef, list_seeds, reason_of, unreadable
from scex_sumo.ranking.task import Parcel, SeedTask, Settings
from scex_sumo.ranking.workers import Order


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What a ranking does.

    Attributes:
        recordings: the dataset.
        every_s: least time between two seeds of a recording.
        min_vehicles: fewer moving vehicles make no seed.
        first: children of every seed.
        children: children of a seed at most.
        top: moments on the page.
        settings: of the runs.
    """

    recordings: tuple[Recording, ...]
    every_s: float
    min_vehicles: int
    first: int
    children: int
    top: int
    settings: Settings


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What shall be run.

    Attributes:
        seeds: those of a recording that shall.
        first: number of their first child.
        stop: one more than that of the last.
        spare: how many more children of a seed may have their tracks kept.
        settings: of the runs.
    """

    seeds: Callable[[Listing], Sequence[SeedRef]]
    first: int
    stop: int
    spare: Callable[[SeedRef], int]
    settings: Settings


def cut(plan: Plan, listings: Mapping[str, Listing], wanted: Wanted) -> Iterator[Listing | Failure | Order]:
    """Everything that is wanted, recording by recording; what is wrong with one stops none of the others.

    Args:
        plan: the ranking.
        listings: by recording, those looked at before; recordings of which nothing is wanted are not loaded.
        wanted: what shall be run.

    Yields:
        The listing of each recording that had none, then its orders; failures in their place.
    """
    for recording in plan.recordings:
        listing = listings.get(recording.name)
        todo = () if listing is None else wanted.seeds(listing)
        if listing is not None and not todo:
            continue
        try:
            loaded = load_recording(recording)
            parcel = Parcel.of(loaded.road)
            if listing is None:
                moments = recording_moments(loaded, every_s=plan.every_s)
                listing = list_seeds(recording, moments, min_vehicles=plan.min_vehicles)
                yield listing
                todo = wanted.seeds(listing)
        except Exception as error:
            if listing is None:
                yield unreadable(recording, reason_of(error))
            for ref in todo:
                yield Failure.of(ref, reason_of(error))
            continue
        for ref in todo:
            try:
                scene = seed_at(loaded, ref.time_s, case=ref.case or None)
            except Exception as error:
                yield Failure.of(ref, reason_of(error))
                continue
            task = SeedTask(
                seed=ref.seed,
                scene=dataclasses.replace(scene, road=None),
                first=wanted.first,
                stop=wanted.stop,
                spare=wanted.spare(ref),
                settings=wanted.settings,
            )
            yield Order(ref=ref, task=task, parcel=parcel)
