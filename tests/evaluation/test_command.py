"""The command ``metrics`` from its arguments to its exit status."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import csv

from tests.command import status

HEADER = "case_id,track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"


@pytest.fixture
def tracks(tmp_path: Path) -> Path:
    """Two cars of one case over 12 steps; 1 follows 2 and closes in by 1 m per step from 30 m."""
    rows = [
        f"1,{track},{k},{100 * k},car,{start + speed * 0.1 * k},0,{speed},0,0,4.5,1.8"
        for track, start, speed in ((1, 0.0, 20.0), (2, 31.0, 10.0))
        for k in range(1, 13)
    ]
    path = tmp_path / "tracks.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    return path


def test_a_result_folder_is_evaluated_after_its_history(tracks: Path, tmp_path: Path) -> None:
    """Ten of the twelve frames are history: what is left is 20 m and 19 m."""
    folder = tmp_path / "result"
    folder.mkdir()
    pq.write_table(csv.read_csv(tracks), folder / "tracks.parquet")
    assert status("metrics", folder, "-o", tmp_path / "out.parquet") == 0
    table = pq.read_table(tmp_path / "out.parquet")
    assert table["distance_mean"].to_pylist() == [pytest.approx(19.5)]


@pytest.mark.parametrize(
    ("arguments", "expected", "message"),
    [
        (["--level", "pairs"], 2, "unknown level 'pairs'; known: pair, scene, scenario"),
        (["--preset", "best"], 2, "unknown metric 'best'; nearest: "),
        (["--metrics", "ttc,speed"], 2, "unknown metric 'speed'; nearest: "),
        (["-o", "out.xlsx"], 2, "unknown format '.xlsx'"),
    ],
)
def test_mistakes_are_told_in_one_line(
    arguments: list[str], expected: int, message: str, tracks: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status("metrics", tracks, *arguments) == expected
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_files_that_cannot_be_read_are_named(
    tmp_path: Path, tracks: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken.parquet").write_text("no parquet")
    (tmp_path / "empty").mkdir()
    table = csv.read_csv(tracks)
    holes = np.where(np.arange(table.num_rows) == 3, np.nan, 1.0)
    pq.write_table(table.set_column(7, "vx", pa.array(holes)), tmp_path / "holes.parquet")
    names = pa.array([f"car{i}" for i in table["track_id"].to_pylist()])
    pq.write_table(table.set_column(1, "track_id", names), tmp_path / "names.parquet")
    for name, message in (
        ("missing.csv", "missing.csv"),
        ("broken.parquet", "cannot be read as Parquet"),
        ("empty", "no tracks.parquet in it"),
        ("holes.parquet", "column vx has missing values"),
        ("names.parquet", "track_id 'car1' of a car is not an integer"),
    ):
        assert status("metrics", tmp_path / name) == 1
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
