"""From pairs to scenes to futures: extrema, means, masks, and where the worst value came from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import InputError, UsageError
from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.metrics import evaluate as evaluation
from scex_sumo.metrics.base import PlannedPaths, SceneTracks
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.pairs.scenes import Samples
from scex_sumo.metrics.registry import COLUMNS, METRICS, Metric
from scex_sumo.scene import States
from tests.metrics.scenes import one_scene, random_run


def on_a_line(*x: list[float], first: int = 0, speeds: tuple[float, ...] | None = None) -> SceneTracks:
    """One future; ``x`` per vehicle, step by step, heading along x; NaN = absent."""
    position = np.array(x, dtype=float).T[None]
    speed = np.broadcast_to(np.array(speeds or [1.0] * len(x)), position.shape).copy()
    return SceneTracks(
        states=States(x=position, y=np.zeros_like(position), heading=np.zeros_like(position), speed=speed),
        length=np.full(len(x), 1.0),
        width=np.full(len(x), 1.0),
        present=~np.isnan(position),
        first=first,
    )


def test_the_columns_are_in_the_order_of_the_definitions() -> None:
    assert COLUMNS == (
        "distance", "distance_mean", "tq", "tq_mean", "gap_time", "gap_time_mean",
        "pttc", "pttc_mean", "wttc", "wttc_mean", "ttc", "ttc_mean",
    )  # fmt: skip


def test_extremum_and_mean_of_the_scenes_extrema() -> None:
    """Smallest distances of the three steps: 3, 4, 2."""
    tracks = on_a_line([0, 0, 0], [5, 4, 7], [8, 10, 9])
    result = evaluate(tracks, None, metrics=("distance",))
    assert result.scene["distance"].value.tolist() == [[3.0, 4.0, 2.0]]
    assert result.values.tolist() == [[2.0, 3.0]]


def test_history_is_not_evaluated() -> None:
    tracks = on_a_line([0, 0, 0], [0.1, 4, 7], first=1)
    assert evaluate(tracks, None, metrics=("distance",)).values.tolist() == [[4.0, 5.5]]


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_vehicles_leave_everything_undefined(count: int) -> None:
    tracks = one_scene([{"x": 0, "v": 3}] * count)
    planned = PlannedPaths.from_tracks(tracks)
    result = evaluate(tracks, planned)
    assert result.values.shape == (1, 12)
    assert not result.defined.any()
    assert np.isnan(result.values).all()
    assert all(rows.value.size == 0 for rows in evaluate_pairs(tracks, planned).values())


def test_without_planned_paths_only_gap_time_is_undefined() -> None:
    tracks, planned = random_run(np.random.default_rng(2), vehicles=6)
    without, given = evaluate(tracks, None), evaluate(tracks, planned)
    gap = np.array([name.startswith("gap_time") for name in COLUMNS])
    assert given.defined[:, gap].any()
    assert not without.defined[:, gap].any()
    np.testing.assert_array_equal(without.values[:, ~gap], given.values[:, ~gap])


@pytest.mark.parametrize("absent", [0.0, 0.4])
def test_futures_do_not_depend_on_who_shares_their_batch(
    absent: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracks, planned = random_run(np.random.default_rng(3), futures=7, absent=absent)
    together = evaluate(tracks, planned)
    for pair_steps in (1, 200):
        monkeypatch.setattr(evaluation, "BATCH_PAIR_STEPS", pair_steps)
        np.testing.assert_array_equal(evaluate(tracks, planned).values, together.values)
    for future in range(7):
        alone = evaluate(
            tracks.futures(slice(future, future + 1)), planned.futures(slice(future, future + 1))
        )
        np.testing.assert_array_equal(alone.values[0], together.values[future])


@pytest.mark.parametrize("absent", [0.0, 0.4])
def test_scenes_and_futures_are_the_extrema_of_the_pairs(absent: float) -> None:
    tracks, planned = random_run(np.random.default_rng(4), futures=3, absent=absent, vehicles=6)
    result, pairs = evaluate(tracks, planned), evaluate_pairs(tracks, planned)
    for name, rows in pairs.items():
        with np.errstate(divide="ignore"):
            value = 1 / rows.value if name == "ttc" else rows.value
        keep = np.isfinite(value) if name == "pttc" else np.ones(value.size, dtype=bool)
        extremum = max if METRICS[name].critical == "max" else min
        for future in range(3):
            scenes = []
            for step in range(tracks.first, tracks.states.shape[1]):
                here = value[keep & (rows.future == future) & (rows.step == step)].tolist()
                at = (future, step - tracks.first)
                assert result.scene[name].defined[at] == bool(here)
                if here:
                    scenes.append(extremum(here))
                    assert result.scene[name].value[at] == scenes[-1]
            assert result.defined[future, COLUMNS.index(name)] == bool(scenes)
            if scenes:
                assert result.column(name)[0][future] == extremum(scenes)
                mean = np.mean(scenes)
                if name == "pttc":  # harmonic, over the scenes in which a pair follows
                    following = len(np.unique(rows.step[rows.future == future]))
                    mean = following / sum(1 / time for time in scenes)
                assert result.column(f"{name}_mean")[0][future] == pytest.approx(mean, rel=1e-12)


def test_the_worst_value_is_traced_to_its_step_and_pair() -> None:
    tracks, planned = random_run(np.random.default_rng(5), futures=4, vehicles=6)
    result, pairs = evaluate(tracks, planned), evaluate_pairs(tracks, planned)
    for name, worst in result.worst.items():
        rows = pairs[name]
        np.testing.assert_array_equal(worst.value, result.column(name)[0])
        for future in np.flatnonzero(worst.defined):
            here = (
                (rows.future == future)
                & (rows.step == worst.step[future])
                & (rows.vehicle == worst.vehicle[future])
            )
            if rows.other is not None and worst.other is not None:
                here &= rows.other == worst.other[future]
            assert here.sum() == 1
            with np.errstate(divide="ignore"):
                value = 1 / rows.value[here] if name == "ttc" else rows.value[here]
            assert value[0] == worst.value[future]


def given_samples(per_scene: list[list[float]]) -> Samples:
    pairs = max(len(scene) for scene in per_scene)
    value, defined = np.zeros((pairs, 1, len(per_scene))), np.zeros((pairs, 1, len(per_scene)), dtype=bool)
    for step, scene in enumerate(per_scene):
        value[: len(scene), 0, step] = scene
        defined[: len(scene), 0, step] = True
    return Samples(value=value, defined=defined, row=np.arange(pairs), other=np.arange(pairs))


INF = float("inf")


@pytest.mark.parametrize(
    ("name", "per_scene", "expected"),
    [
        ("distance", [[5, 3], [4, 6], [7, 2]], (2.0, 3.0)),
        ("ttc", [[INF, 4.0], [2.0], []], (0.5, 0.375)),
        ("ttc", [[INF], [INF, INF]], (0.0, 0.0)),
        ("gap_time", [[1.0], [], [3.0]], (1.0, 2.0)),
        ("gap_time", [[], [], []], (np.nan, np.nan)),
        ("pttc", [[INF, 4.0], [INF], [2.0]], (2.0, 4.0)),  # 3 / (1/4 + 0 + 1/2)
        ("tq", [[0.2, 0.9], [1.3, 0.1], [0.5, 0.4]], (1.3, 0.9)),
    ],
)
def test_aggregation_of_given_values(
    name: str, per_scene: list[list[float]], expected: tuple[float, float]
) -> None:
    given = given_samples(per_scene)
    metric: Metric = replace(METRICS[name], evaluate=lambda scenes: given, quick=None)
    tracks = on_a_line([0.0] * len(per_scene), [1.0] * len(per_scene))
    assert evaluate(tracks, None, metrics=[metric]).values[0] == pytest.approx(
        expected, rel=1e-12, nan_ok=True
    )


def state(value: float) -> FloatArray:
    return np.full((1, 2, 3), value)


def test_what_does_not_fit_is_refused() -> None:
    good = {"x": state(0), "y": state(0), "heading": state(0), "speed": state(0)}
    size = np.ones(3)
    with pytest.raises(InputError, match="speed of vehicle 0 in future 0 at step 0 is not a finite number"):
        SceneTracks(states=States(**{**good, "speed": state(np.nan)}), length=size, width=size)
    with pytest.raises(InputError, match=r"x of vehicle 0 .* not a finite number up to 1e\+12 \(6 such"):
        SceneTracks(states=States(**{**good, "x": state(1e200)}), length=size, width=size)
    with pytest.raises(InputError, match="a width is not within 0 to"):
        SceneTracks(states=States(**good), length=size, width=-size)
    tracks, planned = random_run(np.random.default_rng(0), vehicles=4)
    with pytest.raises(UsageError, match="unknown metric 'speed'; nearest: "):
        evaluate(tracks, planned, metrics=("speed",))
