"""Batches of scenes: a few children at a time, so that the working arrays stay in the processor's cache."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.kinds import shared_pairs
from scex_sumo.metrics.pairs.presets import preset_named
from scex_sumo.metrics.pairs.scenes import Scenes

BATCH_PAIR_STEPS = 1 << 18  # unordered pair-steps per batch
SHARED_PAIR_STEPS = 1 << 21  # of the children that share what equal pairs of tracks have in common; 0: never


def scene_batches(
    tracks: SceneTracks, planned: PlannedPaths | None, *, preset: str, parameters: MetricParameters
) -> Iterator[tuple[int, Scenes]]:
    """Scenes of a few children at a time, each with the number of its first child; arguments as `evaluate`.

    What was derived from a batch is forgotten when the next one is asked for.
    """
    rules = preset_named(preset)
    children, _, vehicles = tracks.states.shape
    if planned is not None:
        planned.check_fit(tracks)
    per_child = max(tracks.steps * vehicles * (vehicles - 1) // 2, 1)
    size, most = (max(limit // per_child, 1) for limit in (BATCH_PAIR_STEPS, SHARED_PAIR_STEPS))
    for begin in range(0, max(children, 1), most):
        group = slice(begin, begin + most)
        some, plans = tracks.children(group), None if planned is None else planned.children(group)
        shared = shared_pairs(some, plans, preset=rules, parameters=parameters)
        for start in range(0, max(some.states.shape[0], 1), size):
            part = slice(start, start + size)
            scenes = Scenes(
                tracks=some.children(part),
                planned=None if plans is None else plans.children(part),
                parameters=parameters,
                preset=rules,
                shared=None if shared is None else replace(shared, row=shared.row[:, part]),
            )
            yield begin + start, scenes
            scenes.release()
        if shared is not None:
            shared.scenes.release()
