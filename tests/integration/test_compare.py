"""``scex-sumo compare`` as a user meets it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.studies.compare.command import short_names
from tests.command import ALONE, scex

PAIRS = 3


def refused(*arguments: object, status: int = 1) -> str:
    done = scex("compare", *arguments)
    assert done.returncode == status, (done.stdout, done.stderr)
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    return lines[0]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Runs of the example seeds, small; the merge twice, with other draws."""
    home = tmp_path_factory.mktemp("runs")
    for name, example, seed in (
        ("ring", "roundabout", 0),
        ("m0", "motorway_merge", 0),
        ("m1", "motorway_merge", 1),
    ):
        done = scex(
            "run",
            scex_sumo.example_path(example),
            *("--futures", 32, "--seed", seed, "--no-plots", *ALONE, "-o", home / name),
        )
        assert done.returncode == 0, done.stderr
    return [home / name for name in ("ring", "m0", "m1")]


def test_it_prints_distances_groups_and_what_sets_apart(folders: list[Path]) -> None:
    done = scex("compare", *folders)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "3 runs, distance w1" in done.stdout
    # Two runs of one seed scene are a group of their own, and the nearest pair.
    assert ": m0, m1\n" in done.stdout or ": m1, m0\n" in done.stdout
    pairs = done.stdout.split("sets them apart most:\n")[1].splitlines()
    assert len(pairs) == PAIRS
    assert pairs[0].strip().startswith("m0 | m1: ")
    assert any(metric in pairs[1] for metric in scex_sumo.open_run(folders[0]).columns)


def test_tables_and_a_page_are_written(folders: list[Path], tmp_path: Path) -> None:
    done = scex("compare", *folders, "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    table = pq.read_table(tmp_path / "out" / "distances.parquet")
    assert table.column_names == ["first", "second", "metric", "distance", "values", "undefined"]
    columns = len(scex_sumo.open_run(folders[0]).columns)
    assert table.num_rows == PAIRS * (1 + columns)
    assert pyarrow.csv.read_csv(tmp_path / "out" / "distances.csv").num_rows == table.num_rows
    whole = np.asarray(table["distance"]).reshape(1 + columns, PAIRS)
    np.testing.assert_allclose(whole[0], whole[1:].mean(axis=0), rtol=1e-12)
    page = (tmp_path / "out" / "compare.html").read_text()
    worst = [name for name in scex_sumo.open_run(folders[0]).columns if not name.endswith("_mean")]
    assert page.count("<figure>") == len(worst)
    assert page.count('class="cell"') == 9


def test_the_order_of_the_folders_does_not_change_a_byte(folders: list[Path], tmp_path: Path) -> None:
    for number, order in enumerate((folders, folders[::-1])):
        assert scex("compare", *order, "-o", tmp_path / str(number)).returncode == 0
    for name in ("distances.parquet", "distances.csv", "compare.html"):
        assert (tmp_path / "0" / name).read_bytes() == (tmp_path / "1" / name).read_bytes(), name


def test_nearest_lists_the_others_by_distance(folders: list[Path]) -> None:
    done = scex("compare", folders[0], folders[1], "--nearest", folders[2], "--distance", "jsd")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.split("nearest to m1:\n")[1].splitlines()
    assert [line.split()[1] for line in lines] == ["m0:", "ring:"]


def test_a_copy_is_at_no_distance_and_said(folders: list[Path], tmp_path: Path) -> None:
    shutil.copytree(folders[0], tmp_path / "copy")
    done = scex("compare", folders[0], tmp_path / "copy")
    assert done.returncode == 0, done.stderr
    assert "note: ring holds the same run as copy" in done.stderr
    assert "copy | ring: 0.00; nothing sets them apart" in done.stdout


def test_fewer_than_two_folders_or_one_twice_is_a_usage_error(folders: list[Path]) -> None:
    assert "at least two" in refused(folders[0], status=2)
    assert "named twice" in refused(folders[0], folders[1], folders[0].parent / "." / "ring", status=2)


def test_options_that_make_no_sense_are_usage_errors(folders: list[Path]) -> None:
    assert "known: w1, jsd" in refused(*folders, "--distance", "l2", status=2)
    assert "--groups" in refused(*folders, "--groups", 4, status=2)


def test_an_unfinished_or_missing_result_is_refused(folders: list[Path], tmp_path: Path) -> None:
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "incomplete.json").write_text("{}")
    assert "interrupted" in refused(folders[0], tmp_path / "half")
    assert "no such folder" in refused(folders[0], tmp_path / "nowhere")


def test_runs_of_another_length_are_refused(folders: list[Path], tmp_path: Path) -> None:
    other = tmp_path / "longer"
    shutil.copytree(folders[1], other)
    info = json.loads((other / "run.json").read_text())
    (other / "run.json").write_text(json.dumps({**info, "steps": 50}))
    line = refused(folders[0], other)
    assert "ring: steps per future 30, but longer has 50" in line


def test_a_runs_own_pictures_are_not_overwritten(folders: list[Path]) -> None:
    assert "folder of its own" in refused(*folders, "-o", folders[0], status=2)


def test_an_unwritable_folder_is_said(folders: list[Path], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = scex("compare", *folders, "-o", tmp_path / "file" / "out")
    assert done.returncode == 1
    assert done.stderr.startswith("error: ") and "cannot write" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_names_are_as_long_as_needed() -> None:
    assert short_names([Path("/out/a"), Path("/out/b")]) == ["a", "b"]
    assert short_names([Path("/x/one/v1"), Path("/x/two/v1")]) == ["one/v1", "two/v1"]
