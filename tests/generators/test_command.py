"""``scex-sumo generate`` and ``run --synthetic N --as recorded``."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.generators.command import generate_command
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_model import load_scenes
from scex_sumo.scenarios import example_path
from scex_sumo.scenarios.seeds import read_seed
from tests.command import ALONE, scex

MAP = example_path("urban_intersection")


def test_cases_read_back_are_the_scenes_and_repeat_to_the_byte(tmp_path: Path) -> None:
    generate_command(MAP, vehicles=7, count=2, out=tmp_path / "a")
    generate_command(MAP, vehicles=7, count=2, out=tmp_path / "b")
    cases = [tmp_path / folder / f"{MAP.stem}.csv" for folder in "ab"]
    assert cases[0].read_bytes() == cases[1].read_bytes()
    scene = read_seed(tmp_path / "a" / MAP.name, case="2", cache=False)
    assert scene.road is not None
    made = generated_scene(scene.road, load_scenes(), vehicles=7, number=1)
    assert scene.vehicles == 7 and (scene.recorded_steps >= 9).all()
    assert np.hypot(scene.now.x - made.now.x, scene.now.y - made.now.y).max() < 0.05
    assert np.abs(scene.now.speed - made.now.speed).max() < 0.3  # cases are repaired


def test_a_run_starts_from_a_generated_case(tmp_path: Path) -> None:
    generate_command(MAP, vehicles=4, count=1, out=tmp_path / "scenes")
    options = ["--futures", 2, "--models", "rules", *ALONE, "--no-report", "--world", "plain"]
    done = scex("run", tmp_path / "scenes" / MAP.name, *options, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "run.json").is_file()


def test_a_recording_beside_the_map_is_never_replaced(tmp_path: Path) -> None:
    the_map = Path(shutil.copy(MAP, tmp_path))
    recording = the_map.with_suffix(".csv")
    recording.write_text("mine")
    with pytest.raises(ResultError, match=r"\.csv: exists, and not as scex-sumo wrote it"):
        generate_command(the_map, vehicles=2, count=1, out=tmp_path, overwrite=True)
    assert recording.read_text() == "mine" and the_map.read_bytes() == MAP.read_bytes()


def test_a_folder_is_replaced_only_on_demand(tmp_path: Path) -> None:
    generate_command(MAP, vehicles=2, count=1, out=tmp_path)
    with pytest.raises(ResultError, match="exists; --overwrite replaces it"):
        generate_command(MAP, vehicles=2, count=1, out=tmp_path)
    generate_command(MAP, vehicles=2, count=1, out=tmp_path, overwrite=True)
    with pytest.raises(UsageError, match="--count: got 0"):
        generate_command(MAP, count=0, out=tmp_path)
