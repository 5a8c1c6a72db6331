"""A seed scene written as INTERACTION tracks is the same when read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scex_sumo.converters.datasets.recordings import recorded_scene
from scex_sumo.converters.datasets.writer import write_tracks
from scex_sumo.scene import SeedScene, States
from tests.converters.track_files import moving, straight, write_rows
from tests.seeds import straight_seed


def _same_states(a: States, b: States) -> None:
    for name in ("x", "y", "heading"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=0, atol=1e-9, err_msg=name)
    # speed goes through its components: two roundings
    np.testing.assert_allclose(a.speed, b.speed, rtol=1e-12, atol=1e-12)


def same(a: SeedScene, b: SeedScene) -> None:
    np.testing.assert_array_equal(a.track_ids, b.track_ids)
    assert a.types == b.types
    np.testing.assert_array_equal(a.length, b.length)
    np.testing.assert_array_equal(a.width, b.width)
    np.testing.assert_array_equal(a.recorded_steps, b.recorded_steps)
    _same_states(a.history, b.history)
    assert (a.future is None) == (b.future is None)
    if a.future is not None and b.future is not None:
        _same_states(a.future, b.future)
        assert a.future_valid is not None
        assert b.future_valid is not None
        np.testing.assert_array_equal(a.future_valid, b.future_valid)
    assert (a.obstacles is None) == (b.obstacles is None)
    if a.obstacles is not None and b.obstacles is not None:
        assert (a.obstacles.ids, a.obstacles.types) == (b.obstacles.ids, b.obstacles.types)
        np.testing.assert_array_equal(a.obstacles.present, b.obstacles.present)
        _same_states(a.obstacles.states, b.obstacles.states)


def test_reading_what_was_written_gives_the_seed_back(tmp_path: Path) -> None:
    circle = lambda t: (20.0 * np.sin(0.4 * t), 20.0 * (1.0 - np.cos(0.4 * t)))  # noqa: E731
    rows = moving(circle, 4, range(60), kind="truck", length=9.0, width=2.5)
    rows += straight(11, range(16, 50), y=9.0)
    rows += straight(2, range(12, 30), y=40.0, speed=1.2, kind="bike")
    rows += straight(7, range(60), y=60.0, speed=0.0)
    tracks = write_rows(tmp_path / "t.csv", rows)
    scene = recorded_scene(tmp_path / "town.osm", tracks=tracks, time_s=2.0)
    written = write_tracks(tmp_path / "seed.csv", scene)
    again = recorded_scene(tmp_path / "town.osm", tracks=written)
    same(scene, again)
    assert again.time_s == 1.0  # the clock of a case


def test_a_seed_without_future_or_obstacles_comes_back_too(tmp_path: Path) -> None:
    scene = straight_seed(3)
    same(scene, recorded_scene(tmp_path / "town.osm", tracks=write_tracks(tmp_path / "s.csv", scene)))


@pytest.mark.parametrize("time_s", [12.0, 60.0, 101.0, 140.0])
def test_scenes_of_k733_come_back(data: Path, tmp_path: Path, time_s: float) -> None:
    the_map = data / "taf_bw/maps/k733_2020-09-15.osm"
    scene = recorded_scene(the_map, time_s=time_s)
    same(scene, recorded_scene(the_map, tracks=write_tracks(tmp_path / "s.csv", scene)))
