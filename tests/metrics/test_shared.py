"""Pairs of tracks that are equal in several futures are measured once, to the same bytes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics import evaluate as evaluation
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import evaluate, track_pairs
from tests.metrics.scenes import find_encounters, random_run

METRICS = ("paper", "path")


def mixed_run(seed: int, *, absent: float = 0.0) -> tuple[SceneTracks, PlannedPaths]:
    """Forty futures in which every vehicle has one of three tracks, by even seeds with other plans."""
    rng = np.random.default_rng(seed)
    tracks, planned = random_run(rng, futures=3, vehicles=5, absent=absent)
    which = rng.integers(3, size=(40, 5)), np.arange(5)
    plans = which[0] if seed % 2 else rng.integers(3, size=(40, 5)), np.arange(5)
    states = tracks.states.map(lambda values: values[which[0], :, which[1]].swapaxes(1, 2))
    present = (
        tracks.present if tracks.present is None else tracks.present[which[0], :, which[1]].swapaxes(1, 2)
    )
    x, y = (values[plans[0], :, plans[1]].swapaxes(1, 2) for values in (planned.x, planned.y))
    return replace(tracks, states=states, present=present), replace(planned, x=x, y=y)


@pytest.mark.parametrize(
    ("seed", "absent"),  # plans apart, and shared
    [(0, 0.0), (0, 0.2), (1, 0.2), (1, 0.0)],
)
def test_sharing_changes_no_byte(seed: int, absent: float, monkeypatch: pytest.MonkeyPatch) -> None:
    tracks, planned = mixed_run(seed, absent=absent)
    found = []
    for pair_steps in (evaluation.SHARED_PAIR_STEPS, 0):
        monkeypatch.setattr(evaluation, "SHARED_PAIR_STEPS", pair_steps)
        values = evaluate(tracks, planned, metrics=METRICS)
        some = evaluate(tracks, planned, metrics=METRICS, vehicles=[1, 3])
        pairs = evaluate_pairs(tracks, planned, metrics=METRICS)
        met = find_encounters(tracks, planned)
        arrays = [values.values, values.defined, some.values, *(getattr(met, f.name) for f in fields(met))]
        for part in (*values.scene.values(), *values.worst.values(), *pairs.values()):
            arrays += [getattr(part, f.name) for f in fields(part)]
        found.append([None if array is None else array.tobytes() for array in arrays])
    assert found[0] == found[1]


def test_of_many_futures_each_pair_of_tracks_is_there_once() -> None:
    """Five vehicles of three tracks each: ten pairs of nine."""
    tracks, planned = mixed_run(1)
    shared = track_pairs(tracks, planned)
    assert shared is not None
    assert shared.scenes.vehicles == 15
    assert len(shared.scenes.pairs[0]) <= 90
    first, second = np.triu_indices(5, 1)
    for side, vehicle in zip(shared.scenes.pairs, (first, second), strict=True):
        there = shared.scenes.tracks.states.x[0].T[side[shared.row]]  # (P, C, T)
        assert np.array_equal(there, tracks.states.x.transpose(2, 0, 1)[vehicle])
