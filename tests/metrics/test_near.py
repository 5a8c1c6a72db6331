"""Near pairs: extrema found from them alone are those of all pairs, to the same bytes."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.pairs import near
from scex_sumo.metrics.pairs.near import near_pairs
from scex_sumo.scene import States
from tests.metrics.scenes import find_encounters, random_run


def standing(x: list[float]) -> SceneTracks:
    """One future of two steps in which cars of 4 m by 2 m stand on a line."""
    at = np.broadcast_to(np.array(x), (1, 2, len(x)))
    states = States(x=at, y=0 * at, heading=0 * at, speed=0 * at)
    return SceneTracks(states=states, length=np.full(len(x), 4.0), width=np.full(len(x), 2.0))


def test_standing_cars_are_near_where_a_search_for_leaders_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 m straight ahead, 1 m for rounding, the widths of both; pairs are 01, 02, 12."""
    monkeypatch.setattr(near, "MIN_PAIRS", 0)
    found = near_pairs(standing([0, 24.9, 50]), None)
    assert found is not None and found[0].tolist() == [0]


def test_without_a_near_pair_nothing_crosses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(near, "MIN_PAIRS", 0)
    tracks = standing([0.0, 1000.0, 3000.0])
    values = evaluate(tracks, PlannedPaths.from_tracks(tracks), metrics=("gap", "gap_time", "pet"))
    assert values.values[0, 0] == 996 and values.defined[0].tolist() == [True, True, *[False] * 4]


@pytest.mark.parametrize("longer", [1, 5])
@pytest.mark.parametrize(("seed", "absent", "same"), [(0, 0.0, 1), (1, 0.2, 1), (2, 0.0, 4), (3, 0.2, 4)])
def test_far_pairs_change_no_byte(
    seed: int, absent: float, same: int, longer: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``same``: how often each of two futures is there, so that their pairs of tracks are shared.

    Plans that are ``longer`` cross far from the vehicles.
    """
    rng, area = np.random.default_rng(seed), 250 * longer
    tracks, planned = random_run(rng, futures=1, vehicles=12, area=area, absent=absent)
    x, y = (v[..., :1] + longer**2 * (v - v[..., :1]) for v in (planned.x, planned.y))
    planned = replace(planned, x=x, y=y)
    times, vehicle = np.zeros(2 * same, dtype=np.int64), np.arange(12)
    states = tracks.states.map(lambda values: values[times])
    states.x[same:] += np.where(vehicle % 2, 3.0, 0.0)
    present = None if tracks.present is None else tracks.present[times]
    tracks = replace(tracks, states=states, present=present)
    planned = replace(planned, x=planned.x[times], y=planned.y[times])
    found = []
    for few in (0, 10**9):
        monkeypatch.setattr(near, "MIN_PAIRS", few)
        assert (near_pairs(tracks, planned) is None) == bool(few)
        values = evaluate(tracks, planned, metrics=("paper", "path"))
        some = evaluate(tracks, planned, metrics=("paper", "path"), vehicles=[1, 3])
        met = find_encounters(tracks, planned)
        arrays = [values.values, values.defined, some.values, *(getattr(met, f.name) for f in fields(met))]
        for part in (*values.scene.values(), *values.worst.values()):
            arrays += [getattr(part, f.name) for f in fields(part)]
        found.append([None if array is None else array.tobytes() for array in arrays])
    assert found[0] == found[1]
