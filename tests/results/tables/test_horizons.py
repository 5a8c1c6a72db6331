"""Metrics of the first seconds of longer futures: as a run of so many seconds measures them."""

from __future__ import annotations

from pathlib import Path

import pytest

import scex_sumo as scex
from scex_sumo.base.errors import UsageError


def run_of(steps: int, folder: Path) -> scex.Run:
    scene = scex.read_seed(scex.example_path("motorway_merge"))
    left_out = {"reference": None, "report": False}
    return scex.extrapolate(
        scene, futures=4, models="constant_velocity", steps=steps, world="plain", out=folder, **left_out
    )


def test_the_first_three_seconds_of_a_longer_run_are_those_of_a_run_of_three_seconds(tmp_path: Path) -> None:
    longer, shorter = run_of(40, tmp_path / "longer"), run_of(30, tmp_path / "shorter")
    assert longer.horizons_s == (1.0, 2.0, 3.0)
    for column in shorter.columns:
        early = longer.values(column, until_s=3.0)
        # Metrics on the path look along driven tracks, which are sampled anew when they are longer.
        assert early == pytest.approx(shorter.values(column), rel=1e-3, nan_ok=True), column
    assert (longer.density("drac", until_s=3.0).pdf == shorter.density("drac").pdf).all()
    assert longer.p_critical("wttc", until_s=3.0) == shorter.p_critical("wttc")


def test_a_time_that_is_not_known_is_one_line_and_a_run_of_three_seconds_has_none(tmp_path: Path) -> None:
    shorter = run_of(30, tmp_path / "shorter")
    assert not (tmp_path / "shorter" / "horizons.parquet").exists()
    with pytest.raises(UsageError, match=r"^until_s=2.0: a run of 3 s has none$"):
        shorter.values("wttc", until_s=2.0)
