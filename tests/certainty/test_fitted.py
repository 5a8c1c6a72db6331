"""Weights fitted to a recording: shares of a mixture, their interval, and what is refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.extra import ExactExtra
from scex_sumo.certainty.fitted import _fit, fitted_weights, mixture, read_fitted, write_fitted
from tests.runs import extrapolate


def drawn(shares: tuple[float, ...], count: int) -> np.ndarray:
    """Errors of models 2 m/s² apart, of which one drives each row, with a scale of 0.3."""
    rng = np.random.default_rng(2)
    model = rng.choice(len(shares), size=count, p=shares)
    real = 2.0 * model + rng.laplace(0, 0.3, count)
    return np.abs(real[:, None] - 2.0 * np.arange(len(shares)))


def test_shares_and_scale_are_those_that_were_drawn() -> None:
    share, scale = mixture(drawn((0.7, 0.2, 0.1), 4000), np.ones(4000))
    assert share == pytest.approx((0.7, 0.2, 0.1), abs=0.03)
    assert scale == pytest.approx(0.3, abs=0.02)


def test_the_interval_is_that_of_vehicles_not_of_plans() -> None:
    """40 plans of each of 10 vehicles are as uncertain as 10."""
    errors = np.repeat(drawn((0.6, 0.4), 10), 40, axis=0)
    names, tracks = ["a", "b"], np.repeat(np.arange(10), 40)
    few, many = _fit(names, tracks, errors, before=True), _fit(names, np.arange(400), errors, before=True)
    assert few.low["a"] <= few.weights["a"] <= few.high["a"]
    assert few.high["a"] - few.low["a"] > 3 * (many.high["a"] - many.low["a"])
    assert (few.windows, few.vehicles) == (400, 10)


def test_the_summary_tells_weights_of_the_folder_and_p_with_them(tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(scex_sumo.example_path("roundabout"))
    run = extrapolate(scene, futures=100, metrics=["gap"], world="plain", out=tmp_path / "run")
    names = [entry["model"] for entry in run.info["models"]]
    errors = np.tile([5.0, 5.0, 0.1, 5.0], (40, 1))
    write_fitted(run.folder, _fit(names, np.arange(40), errors, before=True))
    (line,) = ExactExtra().lines(run)
    assert (
        "constant_velocity 1.00 [1.00–1.00]" in line and "40 plans of 40 vehicles before the moment" in line
    )
    assert read_fitted(run.folder) is not None
    assert ExactExtra().answer(run)["fitted_weights"]["p_collision"] == pytest.approx(
        scex_sumo.weighted_probability(run, {"constant_velocity": 1.0}), abs=1e-6
    )


def test_a_scene_of_no_recording_is_refused(tmp_path: Path) -> None:
    scene = scex_sumo.synthetic_seed(scex_sumo.example_path("roundabout"), vehicles=3)
    run = extrapolate(scene, futures=2, exact=False, world="plain", metrics=["gap"], out=tmp_path / "run")
    with pytest.raises(UsageError, match="of no recording"):
        fitted_weights(run)


def test_a_run_says_why_its_weights_are_not_fitted(tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(scex_sumo.example_path("roundabout"))
    scene = dataclasses.replace(scene, source={"kind": "synthetic"})
    with pytest.warns(scex_sumo.ScexWarning, match="weights are not fitted: .* of no recording"):
        extrapolate(scene, futures=2, exact=False, fit_weights=True, out=tmp_path / "out")
