"""``scex-sumo watch`` as its user meets it: lines, files, errors."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.command import scex
from tests.formats.sumo.simulations import Simulation, write_grid


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return write_grid(tmp_path_factory.mktemp("grid"), output='<tripinfo-output value="trips.xml"/>')


def test_a_configuration_is_watched_to_its_end_and_none_of_its_files_is_written(
    grid: Simulation, tmp_path: Path
) -> None:
    own = ["--from", 20, "--to", 23.05, "--futures", 2, "--models", "constant_velocity"]
    config = os.path.relpath(grid.config, tmp_path)
    done = scex("watch", config, *own, "--workers", 1, "-o", "w", "--json", cwd=tmp_path)
    assert not done.returncode and not done.stderr, done.stderr
    answer = json.loads(done.stdout)
    assert answer["moments"] == 4 and answer["skipped"] == 0
    files = {file.name for file in (tmp_path / "w").iterdir()}
    assert files == {"risk.parquet", "watch.html"}
    times = set(pq.read_table(tmp_path / "w" / "risk.parquet")["time_s"].to_pylist())
    assert times <= {20.0, 21.0, 22.0, 23.0} and {worst["time_s"] for worst in answer["worst"]} <= times
    assert not (grid.config.parent / "trips.xml").exists()


def test_what_cannot_be_watched_is_told_in_one_line(grid: Simulation, tmp_path: Path) -> None:
    broken = tmp_path / "broken.sumocfg"
    broken.write_text('<configuration><net-file value="nowhere.net.xml"/></configuration>')
    for words, said in (
        (["nowhere.sumocfg"], "nowhere.sumocfg"),
        ([broken], "nowhere.net.xml: no such file"),
        ([grid.config, "--follow"], "--follow: needs --gui"),
        ([grid.config, "--models", "nonsense"], "unknown behavior 'nonsense'"),
        ([grid.config, "--every", 0], "--every: got 0"),
    ):
        done = scex("watch", *words, cwd=tmp_path)
        assert done.returncode in (1, 2) and len(done.stderr.splitlines()) == 1, done.stderr
        assert said in done.stderr and not done.stdout
        assert said.startswith("--every") or not (tmp_path / "out").exists()  # that one needs SUMO


def test_a_window_of_its_own_steps_of_a_second_and_teleports_lose_nothing(tmp_path: Path) -> None:
    files = '<gui-settings-file value="view.xml"/><start value="true"/>'
    processing = '<time-to-teleport value="2"/><collision.action value="teleport"/>'
    grid = write_grid(tmp_path, files=files, step_s=1.0, processing=processing)
    (tmp_path / "view.xml").write_text("<viewsettings/>")
    own = ["--from", 12, "--to", 14, "--futures", 2, "--models", "constant_velocity"]
    done = scex("watch", grid.config, *own, "--workers", 1, "-o", "w", "--json", cwd=tmp_path)
    assert not done.returncode and not done.stderr, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["moments"], answer["skipped"]) == (3, 0)
