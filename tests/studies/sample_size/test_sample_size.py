"""How far samples are from all futures."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.extrapolation.assignments import all_assignments
from scex_sumo.scene import SeedScene
from scex_sumo.studies.sample_size.sample_size import choose_vehicles, designed, reduced, subsets
from tests.command import scex
from tests.seeds import straight_seed

ROUNDABOUT = scex_sumo.example_path("roundabout")


def test_subsets_hold_no_future_twice_and_differ() -> None:
    drawn = subsets(50, 20, 9, seed=3)
    assert drawn.shape == (9, 20)
    assert all(len(set(d)) == 20 for d in drawn.tolist())
    assert len({tuple(d) for d in drawn.tolist()}) == 9


def test_designed_draws_are_numbered_as_all_assignments() -> None:
    every = all_assignments([3, 3])
    (draw,) = designed("balanced", 3, 2, 9, 1)
    assert sorted(draw.tolist()) == list(range(9))
    (first,) = designed("balanced", 3, 2, 300, 1)
    assert np.bincount(every[first][:, 0]).tolist() == [100, 100, 100]


def row_of_vehicles(*lateral_m: float) -> SeedScene:
    """Vehicles side by side at these places, driving in parallel."""
    scene = straight_seed(len(lateral_m))
    y = np.repeat(np.array(lateral_m)[:, None], 11, axis=1)
    return dataclasses.replace(scene, history=dataclasses.replace(scene.history, y=y))


def test_the_closest_group_takes_part() -> None:
    seed = row_of_vehicles(0, 50, 90, 93, 99, 140)
    assert choose_vehicles(seed, 2).tolist() == [2, 3]
    assert choose_vehicles(seed, 3).tolist() == [2, 3, 4]
    assert choose_vehicles(seed, 4).tolist() == [1, 2, 3, 4]  # 90 - 50 = 40 is less than 140 - 99 = 41
    assert choose_vehicles(seed, 6).tolist() == list(range(6))


def test_vehicles_that_will_meet_are_closer_than_vehicles_that_part() -> None:
    seed = row_of_vehicles(0, 20, 45)
    heading = np.repeat(np.array([-0.8, 0.4, -0.4])[:, None], 11, axis=1)  # the last two turn to each other
    seed = dataclasses.replace(seed, history=dataclasses.replace(seed.history, heading=heading))
    assert choose_vehicles(seed, 2).tolist() == [1, 2]


def test_a_standing_queue_is_not_the_closest_encounter() -> None:
    seed = row_of_vehicles(0, 4, 8, 50, 70)
    speed = np.repeat(np.array([0.0, 0.0, 0.0, 10.0, 10.0])[:, None], 11, axis=1)
    seed = dataclasses.replace(seed, history=dataclasses.replace(seed.history, speed=speed))
    assert choose_vehicles(seed, 2).tolist() == [3, 4]
    assert choose_vehicles(seed, 3).tolist() == [2, 3, 4]


@pytest.mark.parametrize("count", [0, 4])
def test_more_vehicles_than_there_are_are_refused(count: int) -> None:
    with pytest.raises(UsageError, match=f"straight: has 3 vehicles, but {count} shall take part"):
        choose_vehicles(straight_seed(3), count)


def test_a_reduced_scene_keeps_its_vehicles_as_they_were() -> None:
    seed = row_of_vehicles(0, 50, 90)
    less = reduced(seed, [0, 2])
    assert less.track_ids.tolist() == [0, 2]
    assert less.now.y.tolist() == [0, 90]
    assert less.name == "straight_2v"
    assert reduced(seed, [0, 1, 2]) is seed


def test_the_command_runs_all_assignments_once_and_compares_samples(tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ["--vehicles", 2, "--models", "constant_velocity,emergency_brake,risky_driver", "-o", out]
    options += ["--sizes", "9,4", "--draws", 5, "--no-plots", "--preset", "paper"]
    done = scex("sample-size", ROUNDABOUT, *options, "--designs", "random,balanced")
    assert done.returncode == 0, done.stderr
    assert "2 of" in done.stderr
    table = pq.read_table(out / "sample_size.parquet")
    assert table.num_rows == 12 * 2 * 2  # columns of the preset, designs, sizes
    assert pc.read_csv(out / "sample_size.csv").num_rows == table.num_rows
    whole = [r for r in table.to_pylist() if r["size"] == 9 and r["metric"] == "distance"]
    assert [r["ks_p95"] for r in whole] == [0.0, 0.0]  # nine of nine assignments are all of them
    written = (out / "metrics.parquet").stat().st_mtime_ns
    again = scex("sample-size", ROUNDABOUT, *options)
    assert again.returncode == 0, again.stderr
    assert (out / "metrics.parquet").stat().st_mtime_ns == written  # opened, not run again
    explained = scex("explain", out)
    assert explained.returncode == 0, explained.stderr
    assert "distance" in explained.stdout


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--sizes", "10,x"], "--sizes 10,x: needs whole numbers"),
        (["--draws", 0], "--draws: got 0"),
        (["--vehicles", 99], "but 99 shall take part; give --vehicles"),
        (["--synthetic", 5, "--time", 3], "--synthetic: makes its own tracks"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_line(options: list[object], message: str) -> None:
    done = scex("sample-size", ROUNDABOUT, *options)
    assert done.returncode == 2
    (line,) = [x for x in done.stderr.splitlines() if not x.startswith("note: ")]
    assert message in line
