"""Bands that a run goes on for."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.statistics.bands import Look, grow, look
from scex_sumo.statistics.designs import balanced
from scex_sumo.statistics.intervals import DesignIntervals
from tests.command import ALONE, scex

QUICK = ("--no-plots", *ALONE)
FOURS = [[0.25] * 4] * 4


def test_a_look_names_the_widest_band_and_leaves_out_what_is_rare() -> None:
    levels = balanced(FOURS, 200, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    values = np.stack([levels[:, 0] * 1.0, rng.normal(size=200), rng.normal(size=200)], axis=1)
    defined = np.ones((200, 3), dtype=bool)
    defined[39:, 2] = False  # 39 of 200 are below 20 %
    found = look(DesignIntervals(levels, design="balanced"), values, defined, ("a", "b", "c"))
    assert found.metric == "b"
    assert found.left_out == ("c",)
    assert found.futures == 200


def widths(constant: float, asked: list[int]):  # type: ignore[no-untyped-def]
    def measure(count: int) -> Look:
        asked.append(count)
        return Look(futures=count, width=constant / np.sqrt(count), metric="m", left_out=())

    return measure


def test_a_run_grows_until_the_band_is_narrow_enough_and_little_further() -> None:
    asked: list[int] = []
    end = grow(widths(1.358, asked), band=0.05, most=10_000)
    assert end.width <= 0.05
    assert end.futures < 1.05 * (1.358 / 0.05) ** 2
    assert asked == sorted(set(asked))
    assert len(asked) < 8


def test_a_run_ends_at_the_most_futures_in_any_case() -> None:
    assert grow(widths(1.358, []), band=0.01, most=500).futures == 500
    assert grow(widths(1.358, []), band=0.01, most=7).futures == 7


@pytest.mark.parametrize("band", [0.0, -0.1, 1.0, float("nan")])
def test_a_band_that_makes_no_sense_is_refused(band: float) -> None:
    with pytest.raises(UsageError, match="between 0 and 1"):
        RunSettings(until_band=band)


def test_a_run_until_a_band_is_the_same_whatever_the_batches_and_workers(tmp_path: Path) -> None:
    words = ("--until-band", 0.01, "--futures", 130, "--steps", 3, *QUICK, "-o")
    for name, options in (("one", []), ("two", ["--workers", "2", "--batch", "32"])):
        done = scex("run", scex_sumo.example_path("motorway_merge"), *words, tmp_path / name, *options)
        assert done.returncode == 0, done.stderr
        assert "after 130 futures, not the +-0.01 asked for" in done.stdout
    info = json.loads((tmp_path / "one" / "run.json").read_text())
    assert info["futures"] == info["band"]["futures"] == 130
    for name in ("metrics.parquet", "assignments.parquet", "tracks.parquet"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
