"""Batches of scenes: a few children at a time, so that the working arrays stay in the processor's cache."""

from __future__ import annotations

from collections.abc import Iterator

from scex_sumo.metrics.base import MetricParameters, PlannedPaths, SceneTracks
from scex_sumo.metrics.pairs.presets import preset_named
from scex_sumo.metrics.pairs.scenes import Scenes

BATCH_PAIR_STEPS = 1 << 16  # unordered pair-steps per batch


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
    size = max(BATCH_PAIR_STEPS // per_child, 1)
    for start in range(0, max(children, 1), size):
        part = slice(start, start + size)
        scenes = Scenes(
            tracks=tracks.children(part),
            planned=None if planned is None else planned.children(part),
            parameters=parameters,
            preset=rules,
        )
        yield start, scenes
        scenes.release()
