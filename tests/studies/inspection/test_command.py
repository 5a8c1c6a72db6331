"""``inspect`` says what a recording holds, so that a moment and its vehicles can be chosen."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from scex_sumo import example_path, read_seed
from scex_sumo.base.errors import TrackError
from scex_sumo.studies.inspection.command import inspect_command

MAP = Path(example_path("roundabout"))


def table_of(said: str) -> list[list[str]]:
    """Cells of the table after that of the recording's plausibility."""
    _, _, after = said.partition("vehicles within another one")
    return [line.split("│")[1:-1] for line in after.splitlines()[1:] if line.startswith("│")]


def test_moments_come_with_their_vehicles_and_the_fullest_are_marked(
    capsys: pytest.CaptureFixture[str],
) -> None:
    inspect_command(MAP)
    said = capsys.readouterr().out
    rows = table_of(said)
    assert rows and all(int(row[2]) <= int(row[1]) for row in rows)
    complete = [int(row[2]) for row in rows]
    assert [("*" in row[3]) for row in rows] == [count == max(complete) for count in complete]
    best = f"{read_seed(MAP).time_s:g}"  # the moment that run takes, every 0.1 s
    assert best in [row[0].strip() for row in rows if "*" in row[3]]
    assert said.splitlines()[-1] == f"most vehicles: scex-sumo run {MAP} --time {best}"
    assert "time [s]" in said


def test_a_moment_lists_its_vehicles_by_id(capsys: pytest.CaptureFixture[str]) -> None:
    inspect_command(MAP, time=4.5)
    said = capsys.readouterr().out
    assert "roundabout_t4.5: 14 vehicles" in said
    ids = [int(row[0]) for row in table_of(said)]
    assert ids == list(range(3, 17))
    assert said.splitlines()[-1].endswith("--time 4.5")
    assert "speed [m/s]" in said


def test_a_case_is_named_as_run_names_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head, *rows = MAP.with_suffix(".csv").read_text().splitlines()
    cases = tmp_path / "cases.csv"
    cases.write_text("\n".join([f"case_id,{head}", *(f"{i}.0,{row}" for i in (1, 2) for row in rows)]))
    inspect_command(MAP, tracks=cases, case="1")
    assert capsys.readouterr().out.splitlines()[-1].endswith("--case 1.0")
    inspect_command(MAP, tracks=cases, case="2", time=4.5)
    assert capsys.readouterr().out.splitlines()[-1].endswith("--case 2.0 --time 4.5")
    with pytest.raises(TrackError, match=r"no case 9; it has 2 cases: 1.0, 2.0"):
        inspect_command(MAP, tracks=cases, case="9")
    with pytest.raises(TrackError, match="no case_id column, so no case 9"):
        inspect_command(MAP, case="9")


def test_a_folder_of_recordings_is_a_table_with_the_reason_of_what_cannot_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("roundabout", "motorway_merge"):
        for suffix in (".osm", ".csv"):
            shutil.copy(example_path(name).with_suffix(suffix), tmp_path / f"{name}{suffix}")
    (tmp_path / "motorway_merge.csv").write_text("track_id,frame_id\n1,1\n")
    rows = inspect_command(tmp_path)()["recordings"]
    shown = capsys.readouterr().out
    assert [row["recording"] for row in rows] == ["motorway_merge", "roundabout"]
    assert "not read: " in rows[0]["doubts"][0] and rows[0]["vehicles"] is None
    assert rows[1]["vehicles"] == 17 and rows[1]["seconds"] == pytest.approx(18.0, abs=0.1)
    assert "2 recordings" in shown and "one of them: scex-sumo inspect" in shown
