"""Evaluation of metrics: values of pairs, extrema per scene, microscopic values per future.

A few futures are a batch of scenes; equal tracks are evaluated once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray, distinct
from scex_sumo.base.errors import InputError, ScexError
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.extrema import SceneValues, Worst, extrema, scene_mean
from scex_sumo.metrics.pairs.near import near_pairs
from scex_sumo.metrics.pairs.scenes import Entries, Near, Samples, Scenes, TrackPairs
from scex_sumo.metrics.registry import OURS, Metric, columns_of, metrics_named

BATCH_PAIR_STEPS = 1 << 18  # pair-steps of a batch in which all pairs are near
NEAR_PAIR_STEPS = 1 << 20  # near ones of a batch of others
ALL_PAIR_STEPS = 1 << 21  # pair-steps of a batch
SHARED_PAIR_STEPS = 1 << 22  # near ones of the futures whose equal tracks are evaluated once; 0: never
MAX_DIFFERENT = 0.9  # share of different pairs above which the search for equal ones does not pay


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioValues:
    """Microscopic values, two per future and metric, and their origin."""

    columns: tuple[str, ...]  # (M,) names
    values: FloatArray  # (C, M); NaN where undefined
    defined: BoolArray
    scene: Mapping[str, SceneValues]  # by metric, the extremum of every evaluated step
    worst: Mapping[str, Worst]  # by metric, the step and the vehicles of the extremum

    def column(self, name: str) -> tuple[FloatArray, BoolArray]:
        """Return (C,) values and mask of a column."""
        index = self.columns.index(name)
        return self.values[:, index], self.defined[:, index]


def evaluate(
    tracks: SceneTracks,
    planned: PlannedPaths | None,
    *,
    metrics: Sequence[str | Metric] | None = None,
    vehicles: Collection[int] | None = None,
    also: Callable[[int, Scenes], None] | None = None,
) -> ScenarioValues:
    """Evaluate metrics of every future: most critical value and mean of the scenes' most critical values.

    Args:
        planned: gap time is undefined without planned paths.
        metrics: None for the paper's six.
        vehicles: only values that involve one of these indices; None for all.
        also: called with each batch's first future and scenes.
    """
    chosen = metrics_named(metrics)
    parts: dict[str, list[tuple[SceneValues, Worst]]] = {metric.name: [] for metric in chosen}
    for start, scenes in scene_batches(tracks, planned):
        own = scenes if vehicles is None else scenes.of_vehicles(vehicles)
        for metric in chosen:
            if vehicles is None or metric.pairwise:
                samples = samples_of(metric, own, quick=True)
            else:
                samples = _of_vehicles(dense(samples_of(metric, scenes, quick=False), scenes), vehicles)
            parts[metric.name].append(extrema(metric, samples, scenes))
        if also is not None:
            also(start, scenes)
    scene = {name: SceneValues.join([p[0] for p in batches]) for name, batches in parts.items()}
    worst = {name: Worst.join([p[1] for p in batches]) for name, batches in parts.items()}
    values = [
        column
        for m in chosen
        for column in (worst[m.name].value, scene_mean(scene[m.name], harmonic=m.harmonic))
    ]
    defined = np.repeat(np.stack([worst[m.name].defined for m in chosen], axis=1), 2, axis=1)
    return ScenarioValues(
        columns=columns_of(chosen), values=np.stack(values, axis=1), defined=defined, scene=scene, worst=worst
    )


def scene_batches(tracks: SceneTracks, planned: PlannedPaths | None) -> Iterator[tuple[int, Scenes]]:
    """Yield scenes of a few futures with the number of the first; the next batch drops derived values."""
    futures, _, vehicles = tracks.states.shape
    near = near_pairs(tracks, planned)
    every = vehicles * (vehicles - 1) // 2
    some_pairs = every if near is None else len(near[0])
    group_size, size, size_of_all = (
        max(limit // max(tracks.steps * pairs, 1), 1)
        for limit, pairs in (
            (SHARED_PAIR_STEPS, some_pairs),
            (BATCH_PAIR_STEPS if near is None else NEAR_PAIR_STEPS, some_pairs),
            (ALL_PAIR_STEPS, every),
        )
    )
    size = min(size, size_of_all)
    for begin in range(0, max(futures, 1), group_size):
        group = slice(begin, begin + group_size)
        some, plans = tracks.futures(group), None if planned is None else planned.futures(group)
        shared = track_pairs(some, plans, None if near is None else near[0])
        for start in range(0, max(some.states.shape[0], 1), size):
            part = slice(start, start + size)
            scenes = Scenes(tracks=some.futures(part), planned=None if plans is None else plans.futures(part))
            equal = None if shared is None else shared.of_futures(part)
            if near is None:
                scenes = replace(scenes, shared=equal)
            else:
                those = scenes.of_pair_numbers(near[0], equal)
                scenes = replace(scenes, near=Near(scenes=those, pair=near[0], apart=near[1]))
            yield begin + start, scenes
            scenes.release()
        if shared is not None:
            shared.scenes.release()


def track_pairs(
    tracks: SceneTracks, planned: PlannedPaths | None, pairs: IntArray | None = None
) -> TrackPairs | None:
    """Find the different pairs of tracks; None if few are equal or sizes depend on the future.

    Args:
        pairs: of vehicles, by number; None for all.
    """
    futures, _, vehicles = tracks.states.shape
    sizes = tracks.length, tracks.width, np.empty(0) if tracks.types is None else tracks.types
    same_sizes = all(np.ndim(values) == 1 for values in sizes)
    if futures < 2 or vehicles < 2 or not same_sizes or tracks.acceleration is not None:
        return None
    number, firsts = np.empty((vehicles, futures), dtype=np.int64), list[IntArray]()
    for vehicle in range(vehicles):
        first, of_future = distinct(_all_values(tracks, planned, vehicle))
        number[vehicle] = of_future + sum(map(len, firsts))
        firsts.append(first)
    future, owner = np.concatenate(firsts), np.repeat(np.arange(vehicles), [len(f) for f in firsts])
    chosen = slice(None) if pairs is None else pairs
    one, two = (number[side[chosen]] for side in np.triu_indices(vehicles, 1))
    if len(future) > MAX_DIFFERENT * number.size:
        return None
    keys, row = np.unique(one * len(future) + two, return_inverse=True)
    if not keys.size or len(keys) > MAX_DIFFERENT * one.size:
        return None
    scenes = Scenes(
        tracks=_tracks_of(tracks, future, owner),
        planned=None if planned is None else _plans_of(planned, future, owner),
        chosen=(keys // len(future), keys % len(future)),
    )
    return TrackPairs(scenes=scenes, row=row.reshape(one.shape))


def _all_values(tracks: SceneTracks, planned: PlannedPaths | None, vehicle: int) -> FloatArray:
    states = tracks.states
    parts = [values[:, :, vehicle] for values in (states.x, states.y, states.heading, states.speed)]
    if tracks.present is not None:
        parts.append(tracks.present[:, :, vehicle].astype(np.float64))
    if planned is not None:
        parts += [values[:, :, vehicle].reshape(len(values), -1) for values in (planned.x, planned.y)]
    return np.concatenate(parts, axis=1)


def _tracks_of(tracks: SceneTracks, future: IntArray, vehicle: IntArray) -> SceneTracks:
    return replace(
        tracks,
        states=tracks.states.map(lambda values: np.ascontiguousarray(values[future, :, vehicle].T[None])),
        length=tracks.length[vehicle],
        width=tracks.width[vehicle],
        present=None if tracks.present is None else tracks.present[future, :, vehicle].T[None],
        types=None if tracks.types is None else np.asarray(tracks.types)[vehicle],
    )


def _plans_of(planned: PlannedPaths, future: IntArray, vehicle: IntArray) -> PlannedPaths:
    x, y = (np.ascontiguousarray(v[future, :, vehicle].swapaxes(0, 1)[None]) for v in (planned.x, planned.y))
    return replace(planned, x=x, y=y)


def samples_of(metric: Metric, scenes: Scenes, *, quick: bool) -> Samples | Entries:
    """Return the values of a metric, checked; ``quick`` allows fewer pairs with the same extrema.

    NaN of a user's metric counts as undefined.
    """
    function = metric.quick if quick and metric.quick is not None else metric.evaluate
    try:
        samples = function(scenes)
    except Exception as error:
        if metric.name in OURS or isinstance(error, ScexError):
            raise
        from scex_sumo.base.blame import own_error_reason

        raise InputError(f"metric {metric.name}: {own_error_reason(error)}") from error
    if metric.name in OURS:
        return samples
    if isinstance(samples, Entries):
        return samples.take(np.flatnonzero(~np.isnan(samples.value)))
    if not isinstance(samples, Samples):
        raise InputError(f"metric {metric.name}: returned {type(samples).__name__}, needs Samples")
    shape = (len(samples.row), *scenes.shape)
    if samples.value.shape != shape or samples.defined.shape != shape or samples.defined.dtype != np.bool_:
        raise InputError(
            f"metric {metric.name}: values {samples.value.shape} and mask {samples.defined.shape} "
            f"({samples.defined.dtype}) of {len(samples.row)} rows; both need shape {shape}, the mask bool"
        )
    return replace(samples, defined=samples.defined & ~np.isnan(samples.value))


def dense(samples: Samples | Entries, scenes: Scenes) -> Samples:
    """Return values of all pairs at all steps."""
    return scenes.scattered(samples.where, samples.value) if isinstance(samples, Entries) else samples


def _of_vehicles(samples: Samples, vehicles: Collection[int]) -> Samples:
    keep = np.isin(samples.row, list(vehicles))
    if samples.other is not None:
        keep |= np.isin(samples.other, list(vehicles))
    return replace(samples, defined=samples.defined & keep[:, None, None])
