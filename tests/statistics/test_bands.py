"""Bands that a run goes on for."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.arrays import FloatArray, IntArray
from scex_sumo.errors import UsageError
from scex_sumo.extrapolation.assignments import all_assignments
from scex_sumo.statistics.bands import Bands, Look, check_band, grow, look
from scex_sumo.statistics.density import dkw_half_width
from scex_sumo.statistics.designs import balanced, independent

FOURS = [[0.25] * 4] * 4


def band_half_width(levels: IntArray, values: FloatArray, *, design: str) -> float:
    return Bands(levels, design=design).half_width(values)


def test_independent_draws_have_the_dkw_band_of_the_defined_children() -> None:
    values = np.arange(400.0)
    values[:100] = np.nan
    levels = np.zeros((400, 2), dtype=np.int64)
    # sqrt(ln 40 / 600) = 0.0784
    assert band_half_width(levels, values, design="random") == pytest.approx(0.0784, abs=5e-5)


def test_a_metric_of_one_vehicle_is_known_at_once_from_balanced_draws() -> None:
    levels = all_assignments([4, 4, 4])
    assert band_half_width(levels, levels[:, 2] ** 2.0, design="balanced") < 1e-6
    # 80 runs have each model 20 times, or nearly so.
    levels = balanced(FOURS, 80, np.random.default_rng(0))
    assert band_half_width(levels, levels[:, 2] ** 2.0, design="balanced") < 0.2 * dkw_half_width(80)


def test_where_no_vehicle_matters_balance_narrows_nothing() -> None:
    levels = balanced(FOURS, 800, np.random.default_rng(0))
    width = band_half_width(levels, np.random.default_rng(1).normal(size=800), design="balanced")
    # The largest of 99 residual deviations of shares around 1/2, each 0.5 +- 0.5 %.
    assert 0.97 * dkw_half_width(800) < width <= dkw_half_width(800)


def test_half_the_variance_from_single_vehicles_narrows_the_band_by_the_root_of_two() -> None:
    # Below 1/2 or not is the exclusive or of a coin of vehicle 0 and a hidden biased one: P(equal) = p.
    # The share explained by vehicle 0 is (2p - 1)^2 = 1/2.
    levels = balanced([[0.5, 0.5]] * 3, 1000, np.random.default_rng(2))
    hidden = np.random.default_rng(3).random(1000) < (1 + np.sqrt(0.5)) / 2
    values = np.where(hidden, levels[:, 0], 1 - levels[:, 0]).astype(float)
    width = band_half_width(levels, values, design="balanced")
    assert width == pytest.approx(dkw_half_width(1000) / np.sqrt(2), rel=0.05)


def test_a_metric_of_two_vehicles_together_is_known_as_well_as_their_pairs_are_balanced() -> None:
    # 64 runs have each of the 8 combinations of 3 coins 8 times.
    levels = balanced([[0.5, 0.5]] * 3, 64, np.random.default_rng(0))
    values = (levels[:, 0] ^ levels[:, 2]).astype(float)
    assert band_half_width(levels, values, design="balanced") < 1e-6
    # Seven more runs leave the pairs uneven by one run, which the band has to show.
    levels = balanced([[0.5, 0.5]] * 3, 71, np.random.default_rng(0))
    uneven = band_half_width(levels, (levels[:, 0] ^ levels[:, 2]).astype(float), design="balanced")
    assert 0.001 < uneven < 0.2 * dkw_half_width(71)


def test_independent_draws_taken_for_balanced_keep_nearly_their_band() -> None:
    # Their imbalance is 1 on average: nothing of a vehicle's share is balanced out.
    rng = np.random.default_rng(1)
    ratios = []
    for _ in range(40):
        levels = independent([[0.25] * 4] * 4, 200, rng)
        ratios.append(band_half_width(levels, levels[:, 0] * 1.0, design="balanced") / dkw_half_width(200))
    assert np.mean(ratios) > 0.8


def test_a_metric_defined_nowhere_is_not_known_at_all() -> None:
    levels = balanced(FOURS, 50, np.random.default_rng(0))
    assert band_half_width(levels, np.full(50, np.nan), design="balanced") == 1.0


def test_few_children_have_the_band_of_independent_draws() -> None:
    levels = balanced(FOURS, 20, np.random.default_rng(0))
    assert band_half_width(levels, levels[:, 0] * 1.0, design="balanced") == dkw_half_width(20)


def test_the_estimated_band_holds_about_as_often_as_it_says() -> None:
    # A population of 256 with effects of one, two and all vehicles; 200 samples: 0.95 +- 0.015.
    every = all_assignments([4] * 4)
    value = every[:, 0] + every[:, 1] * every[:, 2] + np.random.default_rng(4).normal(size=256)
    held = []
    for repetition in range(200):
        levels = balanced(FOURS, 128, np.random.default_rng([5, repetition]))
        sample = value[np.ravel_multi_index(tuple(levels.T), (4,) * 4)]
        at = np.sort(value)
        apart = np.searchsorted(np.sort(sample), at, side="right") / 128 - np.arange(1, 257) / 256
        held.append(np.abs(apart).max() <= band_half_width(levels, sample, design="balanced"))
    assert np.mean(held) > 0.9


def test_a_look_names_the_widest_band_and_leaves_out_what_is_rare() -> None:
    levels = balanced(FOURS, 200, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    values = np.stack([levels[:, 0] * 1.0, rng.normal(size=200), rng.normal(size=200)], axis=1)
    defined = np.ones((200, 3), dtype=bool)
    defined[39:, 2] = False  # 39 of 200 are below 20 %
    found = look(levels, values, defined, ("a", "b", "c"), design="balanced")
    assert found.metric == "b"
    assert found.left_out == ("c",)
    assert found.children == 200


def widths(constant: float, asked: list[int]):  # type: ignore[no-untyped-def]
    def measure(count: int) -> Look:
        asked.append(count)
        return Look(children=count, width=constant / np.sqrt(count), metric="m", left_out=())

    return measure


def test_a_run_grows_until_the_band_is_narrow_enough_and_little_further() -> None:
    asked: list[int] = []
    end = grow(widths(1.358, asked), band=0.05, most=10_000)
    assert end.width <= 0.05
    assert end.children < 1.05 * (1.358 / 0.05) ** 2
    assert asked == sorted(set(asked))
    assert len(asked) < 8


def test_a_run_ends_at_the_most_children_in_any_case() -> None:
    assert grow(widths(1.358, []), band=0.01, most=500).children == 500
    assert grow(widths(1.358, []), band=0.01, most=7).children == 7


@pytest.mark.parametrize("band", [0.0, -0.1, 1.0, float("nan")])
def test_a_band_that_makes_no_sense_is_refused(band: float) -> None:
    with pytest.raises(UsageError, match="between 0 and 1"):
        check_band(band)


def test_a_run_until_a_band_is_the_same_whatever_the_batches_and_workers(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scex_sumo", "run", str(scex_sumo.example_path("motorway_merge"))]
    command += ["--until-band", "0.01", "--children", "130", "--steps", "3", "--no-plots", "-o"]
    for name, options in (("one", []), ("two", ["--workers", "2", "--batch", "32"])):
        done = subprocess.run(
            [*command, str(tmp_path / name), *options],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert "after 130 children, not the +-0.01 asked for" in done.stdout
    info = json.loads((tmp_path / "one" / "run.json").read_text())
    assert info["children"] == info["band"]["children"] == 130
    for name in ("metrics.parquet", "assignments.parquet", "tracks.parquet"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
