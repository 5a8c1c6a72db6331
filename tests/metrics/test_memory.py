"""Memory of crossings: vehicles in a queue weave across each other's tracks at every step."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.pairs import paths_ahead
from scex_sumo.scene import STEP_S, States


def queue(vehicles: int, steps: int) -> SceneTracks:
    """One recording of vehicles 5 m behind each other on one lane, with 5 cm of tracking noise."""
    rng = np.random.default_rng(0)
    speed = np.broadcast_to(8 + rng.normal(0, 0.3, vehicles), (1, steps, vehicles)).copy()
    x = 5.0 * np.arange(vehicles) + speed * np.arange(steps)[:, None] * STEP_S
    y = rng.normal(0, 0.05, x.shape)
    states = States(x=x, y=y, heading=np.zeros(x.shape), speed=speed)
    return SceneTracks(states=states, length=np.full(vehicles, 4.5), width=np.full(vehicles, 1.8))


@pytest.mark.parametrize("metric", ["gap_time", "pet"])
def test_blocks_of_pairs_bound_the_memory_and_change_no_byte(
    metric: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracks = queue(24, 100)
    planned = PlannedPaths.from_tracks(tracks)
    results, peaks = [], []
    for rows in (1 << 40, 1 << 16):
        monkeypatch.setattr(paths_ahead, "BLOCK_ROWS", rows)
        tracemalloc.start()
        values = evaluate(tracks, planned, metrics=[metric])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        scene, worst = values.scene[metric], values.worst[metric]
        assert worst.other is not None
        arrays = values.values, scene.value, worst.step, worst.vehicle, worst.other
        results.append([array.tobytes() for array in arrays])
    assert results[0] == results[1]
    assert peaks[1] < peaks[0] / 3
