"""Metric values of what was simulated or recorded: the metrics layer's view of a run."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pyarrow as pa

from scex_sumo.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.evaluation.tables import worst_table
from scex_sumo.extrapolation.rollout import Rollout
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import ScenarioValues, evaluate
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, SeedScene, States


def measure_rollout(
    scene: SeedScene, rollout: Rollout, *, vehicles: Collection[int] | None = None
) -> ScenarioValues:
    """Metric values of a batch of child scenarios, (C, 12); paths are those of the current plans.

    Args:
        scene: the seed scene.
        rollout: the children.
        vehicles: only pairs that involve one of these (indices); None: all.
    """
    count, steps, _ = rollout.states.shape
    tracks = _tracks(scene, scene.history.repeat(count), rollout.states, None)
    made_at = np.arange(0, steps, rollout.replan, dtype=np.int64)
    planned = PlannedPaths.from_replans(rollout.plan_x, rollout.plan_y, made_at, steps)
    return evaluate(tracks, planned, vehicles=vehicles)


def worst_of(scene: SeedScene, values: ScenarioValues, children: IntArray) -> pa.Table:
    """Which step and which vehicles made each child's extremum; times as in ``tracks.parquet``.

    Args:
        scene: the seed scene.
        values: of a batch of child scenarios.
        children: (C,) their numbers.
    """
    steps = next(iter(values.scene.values())).value.shape[1]
    frames = np.arange(1, LOGGED_HISTORY + steps + 1, dtype=np.int64)
    return worst_table(values, child=children, track_ids=scene.track_ids, timestamp_ms=frames * 100)


def measure_recorded(scene: SeedScene, steps: int) -> ScenarioValues | None:
    """The same for what really happened, (1, 12); None where no future was recorded.

    Vehicles count as long as they were recorded; paths are those driven from each step on, to the end of
    the recording that the seed scene holds.
    """
    if scene.future is None or scene.future_valid is None or scene.future.shape[1] == 0:
        return None
    after = scene.future.repeat(1).swapaxes(1, 2)
    whole = _tracks(scene, scene.history.repeat(1), after, scene.future_valid[None].swapaxes(1, 2))
    paths = PlannedPaths.from_tracks(whole)
    # The paths go on to the end of the recording, the values only as far as the children's.
    known = min(steps, after.shape[1])
    until = whole.first + known
    tracks = replace(
        whole,
        states=whole.states[:, :until],
        present=None if whole.present is None else whole.present[:, :until],
    )
    return evaluate(tracks, replace(paths, index=paths.index[:known], column=paths.column[:known]))


def handover_jumps(scene: SeedScene, first: States, by_sumo: BoolArray) -> FloatArray:
    """How far SUMO put the vehicles that it drives from where one step of their motion leads.

    SUMO keeps a vehicle parallel to its lane, so that one that stands askew is turned about its front bumper
    when SUMO takes it over.

    Args:
        scene: the seed scene.
        first: (C, V) states after the first step.
        by_sumo: (C, V) which vehicles SUMO drives.

    Returns:
        (n,) m, one for each vehicle that SUMO drives.
    """
    now = scene.now
    way = now.speed * STEP_S
    x, y = now.x + way * np.cos(now.heading), now.y + way * np.sin(now.heading)
    jumps: FloatArray = np.hypot(first.x - x, first.y - y)[by_sumo]
    return jumps


def _tracks(scene: SeedScene, history: States, after: States, present: BoolArray | None) -> SceneTracks:
    # No more than tracks.parquet holds, so that its children can be evaluated again to the same values.
    past = history[:, :, -LOGGED_HISTORY:].swapaxes(1, 2)
    if present is not None:
        present = np.concatenate([np.ones(past.shape, dtype=bool), present], axis=1)
    return SceneTracks(
        states=States.concatenate([past, after], axis=1),
        length=scene.length,
        width=scene.width,
        present=present,
        step_s=STEP_S,
        first=past.shape[1],
        types=scene.types,
    )
