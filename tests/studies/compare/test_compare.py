"""Distances between runs: by hand, as metrics should be, and whatever the order of the runs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scex_sumo.base.errors import InputError, ResultError, UsageError
from scex_sumo.studies.compare.compare import (
    comparable,
    compare,
    compare_samples,
    pooled_scale,
    wasserstein_distances,
)

INF, NAN = float("inf"), float("nan")
ROUNDING = 1e-9  # sums of at most 80 terms of size 1e3 in other orders

value = st.one_of(st.floats(-100, 100, width=32), st.just(INF), st.just(NAN))
column = st.lists(value, min_size=1, max_size=20).map(np.array)
runs_of_two_metrics = st.lists(st.tuples(column, column), min_size=2, max_size=5)


def arrays(*columns: list[float]) -> list[np.ndarray]:
    return [np.array(c, dtype=float) for c in columns]


def samples(runs: list[tuple[np.ndarray, np.ndarray]]) -> dict[str, list[np.ndarray]]:
    return {"wttc": [one for one, _ in runs], "ttc": [two for _, two in runs]}


def names(count: int) -> list[str]:
    return [f"run{n}" for n in range(count)]


def test_a_metric_with_one_value_everywhere_sets_nothing_apart() -> None:
    comparison = compare_samples({"wttc": arrays([0.0, 0.0], [0.0, 0.0, 0.0])}, names(2))
    assert comparison.scales[0].unit == 1.0
    assert comparison.total[0, 1] == 0.0


def test_a_metric_defined_nowhere_sets_nothing_apart() -> None:
    for distance in ("w1", "jsd"):
        comparison = compare_samples({"pttc": arrays([NAN, NAN], [NAN])}, names(2), distance=distance)
        assert comparison.total[0, 1] == 0.0


def test_undefined_futures_lie_at_the_middle_and_count_as_a_share() -> None:
    # Unit 8, middle 5: a run undefined in half of its futures and at 9 in the others.
    base = [float(n) for n in range(1, 11)]
    half = [NAN] * 5 + [9.0] * 5
    scale = pooled_scale(arrays(base, base))
    assert wasserstein_distances(arrays([5.0] * 10, half), scale)[0, 1] == pytest.approx(0.25, abs=1e-15)
    comparison = compare_samples({"ttc": arrays(base, base, half)}, names(3))
    np.testing.assert_array_equal(comparison.undefined[2, :2, 0], [0.5, 0.5])


def test_the_total_is_the_mean_over_the_metrics_and_the_strongest_is_named() -> None:
    # Same 1/TTC; WTTC at 0 in one run and 1 in the other: unit 1, distance 1. PTTC defined in one run only.
    comparison = compare_samples(
        {
            "ttc": arrays([1.0, 2.0], [1.0, 2.0]),
            "wttc": arrays([0.0, 0.0], [1.0, 1.0]),
            "pttc": arrays([3.0, 3.0], [NAN, NAN]),
        },
        ["a", "b"],
    )
    assert comparison.total[0, 1] == pytest.approx((0 + 1 + 1) / 3)
    assert [metric for metric, _ in comparison.apart(0, 1)] == ["wttc", "pttc", "ttc"]
    np.testing.assert_allclose(comparison.values[0, 1], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(comparison.undefined[0, 1], [0, 0, 1], atol=1e-15)


@given(runs_of_two_metrics, st.sampled_from(["w1", "jsd"]))
def test_symmetric_and_zero_on_itself(runs: list[tuple[np.ndarray, np.ndarray]], distance: str) -> None:
    comparison = compare_samples(samples([*runs, runs[0]]), names(len(runs) + 1), distance=distance)
    np.testing.assert_array_equal(comparison.total, comparison.total.T)
    assert np.all(np.diagonal(comparison.total) == 0)
    assert comparison.total[0, -1] == pytest.approx(0.0, abs=ROUNDING)  # a copy
    assert np.all(comparison.total >= 0)


@given(runs_of_two_metrics, st.sampled_from(["w1", "jsd"]))
def test_no_detour_is_shorter(runs: list[tuple[np.ndarray, np.ndarray]], distance: str) -> None:
    comparison = compare_samples(samples(runs), names(len(runs)), distance=distance)
    for part in (comparison.values, comparison.undefined, comparison.total[:, :, None]):
        detours = part[:, :, None] + part[None]  # from i over j to k
        slack = detours - part[:, None]
        # The root of a divergence that rounding makes 1e-14 too large is 1e-7 too large.
        assert slack.min() >= (-ROUNDING if distance == "w1" else -1e-6)


@given(runs_of_two_metrics, st.randoms(use_true_random=False), st.sampled_from(["w1", "jsd"]))
def test_the_order_of_the_runs_does_not_matter(
    runs: list[tuple[np.ndarray, np.ndarray]], random: object, distance: str
) -> None:
    order = list(range(len(runs)))
    random.shuffle(order)  # type: ignore[attr-defined]
    straight = compare_samples(samples(runs), names(len(runs)), distance=distance)
    shuffled = compare_samples(samples([runs[r] for r in order]), names(len(runs)), distance=distance)
    assert shuffled.scales == straight.scales
    atol = ROUNDING if distance == "w1" else 1e-6
    np.testing.assert_allclose(shuffled.total, straight.total[np.ix_(order, order)], rtol=0, atol=atol)


@pytest.mark.parametrize(("factor", "offset"), [(3.6, 0.0), (0.01, 0.0), (1.0, 100.0)])
def test_units_and_origins_of_a_metric_do_not_matter(factor: float, offset: float) -> None:
    rng = np.random.default_rng(2)
    columns = [rng.gamma(2.0, n, 50) for n in range(1, 6)]
    columns[1][:7], columns[2][:9] = INF, NAN
    one = compare_samples({"pttc": columns}, names(5))
    two = compare_samples({"pttc": [factor * c + offset for c in columns]}, names(5))
    assert two.scales[0].unit == pytest.approx(factor * one.scales[0].unit, rel=1e-12)
    np.testing.assert_allclose(two.total, one.total, rtol=0, atol=ROUNDING)


def test_chance_is_said_at_its_size() -> None:
    """Two runs of one seed scene are as far apart as the noise of each says, within a factor."""
    rng = np.random.default_rng(1)
    drawn = {f"m{n}": [rng.normal(size=400) for _ in range(6)] for n in range(12)}
    comparison = compare_samples(drawn, names(6))
    between = comparison.total[np.triu_indices(6, 1)].mean()
    # Means of 12 distances that scatter by about a third each: 15 % and more to either side are no surprise.
    assert float(np.median(comparison.noise)) == pytest.approx(between, rel=0.35)


def test_one_future_says_nothing_about_chance() -> None:
    comparison = compare_samples({"ttc": arrays([1.0], [2.0])}, names(2))
    assert np.isnan(comparison.noise).all()
    assert comparison.total[0, 1] > 0


def test_nearest_neighbours_are_in_order_and_ties_by_name() -> None:
    comparison = compare_samples({"ttc": arrays([0.0], [5.0], [1.0], [-1.0])}, ["o", "far", "b", "a"])
    assert [comparison.labels[r] for r in comparison.nearest(0)] == ["a", "b", "far"]


def test_an_unknown_distance_or_empty_run_is_refused() -> None:
    with pytest.raises(UsageError, match="unknown distance 'l2'; known: w1, jsd"):
        compare_samples({"ttc": arrays([0.0], [1.0])}, ["a", "b"], distance="l2")
    with pytest.raises(InputError, match="without futures"):
        compare_samples({"ttc": arrays([0.0], [])}, ["a", "b"])


def fake_run(**changed: object) -> SimpleNamespace:
    info = {
        "steps": 30,
        "replan": 5,
        "models": [{"model": "standard_driver", "weight": 1.0}],
        "assign": {},
        "seed_scene": {"name": "seed"},
    }
    columns = changed.pop("columns", ["wttc", "ttc"])
    futures = changed.pop("futures", 40)
    assert isinstance(columns, list) and isinstance(futures, int)
    metrics = pa.table({"future": range(futures), **{c: [float(n) for n in range(futures)] for c in columns}})
    return SimpleNamespace(info={**info, **changed}, columns=columns, futures=futures, metrics=metrics)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"steps": 20}, "steps per future 20, but a has 30"),
        ({"columns": ["wttc"]}, "metrics wttc, but a has ttc, wttc"),
        ({"preset": "path"}, "metric preset path, but a has paper"),
    ],
)
def test_runs_that_measure_something_else_are_refused(changed: dict[str, object], words: str) -> None:
    with pytest.raises(ResultError, match=f"b: {words}; "):
        compare([fake_run(), fake_run(**changed)], ["a", "b"])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"models": [{"model": "risky_driver", "weight": 1.0}]}, "behaviour models of b"),
        ({"assign": {"3": "risky_driver"}}, "fixed models of b"),
        ({"replan": 10}, "replan of b"),
        ({"futures": 10}, "fewer than 30 futures in b"),
    ],
)
def test_other_differences_are_said(changed: dict[str, object], words: str) -> None:
    (note,) = comparable([fake_run(), fake_run(**changed)], ["a", "b"])  # type: ignore[list-item]
    assert words in note


def test_one_run_is_no_comparison() -> None:
    with pytest.raises(UsageError, match="at least two"):
        compare([fake_run()], ["a"])  # type: ignore[list-item]
