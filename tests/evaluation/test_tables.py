"""Recordings as tables: the rows of every level, windows, cases, files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as csv
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError, TrackError, UsageError
from scex_sumo.converters.tracks.reader import TrackTable, read_tracks
from scex_sumo.evaluation import blocks as recording
from scex_sumo.evaluation.blocks import blocks
from scex_sumo.evaluation.command import metrics_command
from scex_sumo.evaluation.sources import read_source
from scex_sumo.evaluation.tables import LEVELS, recording_table
from scex_sumo.metrics.base import PlannedPaths
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.registry import COLUMNS
from tests.metrics.scenes import random_run

HEADER = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"


def write_csv(path: Path, rows: list[str], header: str = HEADER) -> TrackTable:
    path.write_text("\n".join([header, *rows]) + "\n")
    return read_tracks(path)


def row(track: int, frame: int, x: float, y: float, v: float, psi: float = 0.0, kind: str = "car") -> str:
    velocity = f"{v * math.cos(psi)!r},{v * math.sin(psi)!r}"
    return f"{track},{frame},{frame * 100},{kind},{x!r},{y!r},{velocity},{psi!r},4.5,1.8"


@pytest.fixture
def two_cars(tmp_path: Path) -> TrackTable:
    """Track 7 follows track 3: 20 m and 19 m behind, 20 against 10 m/s; a pedestrian is none of it."""
    rows = [row(7, 1, 0, 0, 20.0), row(3, 1, 20, 0, 10.0), row(7, 2, 2, 0, 20.0), row(3, 2, 21, 0, 10.0)]
    return write_csv(tmp_path / "two.csv", [*rows, row(9, 1, 5, 5, 1.0, kind="pedestrian")])


def test_pairs_are_listed_one_row_per_ordered_pair(two_cars: TrackTable) -> None:
    table = recording_table(two_cars, level="pair")
    assert table.column_names == ["case_id", "timestamp_ms", "metric", "track_id", "other_id", "value"]
    rows = table.to_pylist()
    distances = [
        (r["timestamp_ms"], r["track_id"], r["other_id"], r["value"])
        for r in rows
        if r["metric"] == "distance"
    ]
    assert distances == [(100, 3, 7, 20.0), (100, 7, 3, 20.0), (200, 3, 7, 19.0), (200, 7, 3, 19.0)]
    times = [(r["track_id"], r["other_id"], r["value"]) for r in rows if r["metric"] == "ttc"]
    assert times == [(7, 3, pytest.approx(2.0)), (7, 3, pytest.approx(1.9))]
    assert [(r["track_id"], r["other_id"]) for r in rows if r["metric"] == "tq"] == [(3, None), (7, None)] * 2
    assert {r["case_id"] for r in rows} == {1}
    assert not [r for r in rows if r["metric"] == "gap_time"]


def test_scenes_list_the_most_critical_value(two_cars: TrackTable) -> None:
    rows = recording_table(two_cars, level="scene").to_pylist()
    inverse = [(r["timestamp_ms"], r["value"]) for r in rows if r["metric"] == "ttc"]
    assert inverse == [(100, pytest.approx(0.5)), (200, pytest.approx(1 / 1.9))]
    assert list(rows[0]) == ["case_id", "timestamp_ms", "metric", "value"]
    assert [r["metric"] for r in rows[:5]] == ["distance", "tq", "pttc", "wttc", "ttc"]


def test_a_reversing_vehicle_closes_the_gap_behind_it(tmp_path: Path) -> None:
    """Track 3 faces track 7's way and backs at 1 m/s towards it, 8 m in front of it."""
    rows = [row(7, 1, 0, 0, 0.0), row(3, 1, 8, 0, -1.0), row(7, 2, 0, 0, 0.0), row(3, 2, 7.9, 0, -1.0)]
    pairs = recording_table(write_csv(tmp_path / "back.csv", rows), level="pair").to_pylist()
    times = [(r["track_id"], r["other_id"], r["value"]) for r in pairs if r["metric"] == "ttc"]
    assert times == [(7, 3, pytest.approx(8.0)), (7, 3, pytest.approx(7.9))]


def wandering(tmp_path: Path, *, case_id: bool) -> TrackTable:
    """Three random scenes as cases, or one of 100 steps as a recording."""
    rng = np.random.default_rng(5)
    tracks, _ = random_run(
        rng, futures=3 if case_id else 1, steps=40 if case_id else 100, history=1, vehicles=7, absent=0.2
    )
    assert tracks.present is not None
    rows = []
    for future, step, vehicle in np.argwhere(tracks.present):
        at = (future, step, vehicle)
        s = tracks.states
        line = row(
            int(vehicle) + 1,
            int(step) + 1,
            float(s.x[at]),
            float(s.y[at]),
            float(s.speed[at]),
            float(s.heading[at]),
        )
        rows.append(f"{future + 1}.0,{line}" if case_id else line)
    rng.shuffle(rows)
    return write_csv(tmp_path / "random.csv", rows, f"case_id,{HEADER}" if case_id else HEADER)


@pytest.mark.parametrize("level", LEVELS)
def test_windows_change_nothing(level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut into windows of 7 steps, a recording gives the same; sums over 2 s differ by rounding."""
    table = wandering(tmp_path, case_id=False)
    metrics = (*COLUMNS[::2], "drac", "thw", "pet")
    whole = recording_table(table, level=level, metrics=metrics)
    monkeypatch.setattr(recording, "STACKED_STEPS", 1)
    monkeypatch.setattr(recording, "WINDOW_STEPS", 7)
    assert len(list(blocks(table))) == 15
    cut = recording_table(table, level=level, metrics=metrics)
    assert cut.column_names == whole.column_names
    for name in whole.column_names:
        if whole[name].type == pa.float64():
            a, b = (np.array(t[name].to_pylist(), dtype=float) for t in (whole, cut))
            np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-9)
        else:
            assert cut[name].equals(whole[name])


def test_cases_are_evaluated_each_on_its_own(tmp_path: Path) -> None:
    table = wandering(tmp_path, case_id=True)
    together = recording_table(table)
    assert together["case_id"].to_pylist() == [1, 2, 3]
    for index in range(3):
        alone = recording_table(table.case(index))
        assert alone.slice(index, 1).equals(together.slice(index, 1))


def test_planned_paths_of_a_recording_are_the_driven_tracks(tmp_path: Path) -> None:
    """Both arrive at the crossing point: 12 m at 6 m/s and 5 m at 5 m/s."""
    rows = [row(1, k, -12.6 + 0.6 * k, 0, 6.0) for k in range(1, 40)]
    rows += [row(2, k, 0, -5.5 + 0.5 * k, 5.0, math.pi / 2) for k in range(1, 40)]
    table = recording_table(write_csv(tmp_path / "cross.csv", rows), level="pair", metrics=("gap_time",))
    first = {(r["metric"], r["track_id"]): r["value"] for r in table.to_pylist() if r["timestamp_ms"] == 100}
    assert first == {key: pytest.approx(1.0) for key in first}
    assert len(first) == 2


def test_files_are_written_by_their_ending(
    tmp_path: Path, two_cars: TrackTable, capsys: pytest.CaptureFixture[str]
) -> None:
    options = {"level": "pair", "metrics": "paper"}
    for name in ("out.parquet", "out.csv"):
        metrics_command(two_cars.path, out=tmp_path / name, **options)
    read = pq.read_table(tmp_path / "out.parquet")
    assert read.num_rows == recording_table(two_cars, level="pair").num_rows
    assert read.schema.metadata[b"level"] == b"pair"
    assert read.schema.metadata[b"preset"] == b"paper"
    text = (tmp_path / "out.csv").read_text()
    assert text.count("\n") == read.num_rows + 1
    assert "level pair, preset paper" in capsys.readouterr().out
    with pytest.raises(UsageError, match=r"known: \.parquet, \.csv"):
        metrics_command(two_cars.path, out=tmp_path / "out.json", **options)
    with pytest.raises(ResultError, match="cannot write"):
        metrics_command(two_cars.path, out=two_cars.path / "x.csv", **options)


@pytest.mark.parametrize(
    ("metrics", "told"),
    [
        ("path", "level scenario, preset path\n"),
        ("thw,ttc", "level scenario, preset paper, path\n"),
        ("conflicts", "level scenario\n"),
    ],
)
def test_the_rules_for_leaders_are_named(
    metrics: str, told: str, two_cars: TrackTable, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    metrics_command(two_cars.path, metrics=metrics, out=tmp_path / "out.csv")
    assert capsys.readouterr().out.endswith(told)


def test_real_cases_have_values(data: Path) -> None:
    """INTERACTION's own cases: every case with two vehicles at once has a distance; nothing is NaN."""
    table = read_tracks(data / "interaction/cases/v12_case_format_sample.csv")
    pairs = recording_table(table, level="pair")
    assert pairs.num_rows > 1000
    assert not np.isnan(np.asarray(pairs["value"])).any()
    result = recording_table(table)
    assert result["distance"].null_count == 0
    assert evaluate(next(blocks(table)).tracks, None).defined.any()
    assert isinstance(next(blocks(table)).planned, PlannedPaths)


@pytest.mark.parametrize(
    ("stamps_ms", "step_s"),
    [
        ([0, 1000, 2000, 3000, 4000], 1.0),
        ([0, 450, 1000, 1450, 2000, 2550], 0.51),
        ([0, 33, 67, 100, 133, 167, 200], 1 / 30),
        ([0, 100, 200, 900, 1000, 1100, 2100], 0.1),  # two gaps
        ([0, 100, 300, 400, 600], 0.1),  # as many steps twice as long
    ],
)
def test_the_step_of_tracks_from_parquet_is_their_usual_one(
    stamps_ms: list[int], step_s: float, tmp_path: Path
) -> None:
    count = len(stamps_ms)
    write_csv(tmp_path / "whole.csv", [row(1, f, 1.0 * f, 0.0, 10.0) for f in range(1, count + 1)])
    table = csv.read_csv(tmp_path / "whole.csv").append_column("case_id", pa.array(["1"] * count))
    at = table.column_names.index("timestamp_ms")
    pq.write_table(table.set_column(at, "timestamp_ms", pa.array(stamps_ms)), tmp_path / "t.parquet")
    assert read_source(tmp_path / "t.parquet")[0].step_s == pytest.approx(step_s)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("width", 1e200, "column width has values beyond 10000; repair them"),
        ("length", 0.0, "length of a vehicle is not above 0 m; repair it"),
        ("timestamp_ms", 1e-300, "stamps rise by 1e-300 ms, needs at least 1; give them in ms"),
        ("frame_id", -1e308, r"column frame_id has values beyond 1e\+15; repair them"),
        ("vx", 1e155, r"vx of track 1 is 1e\+155, beyond 10000; repair the row, or leave it out"),
    ],
)
def test_parquet_with_a_value_that_would_overflow_is_refused(
    tmp_path: Path, column: str, value: float, message: str
) -> None:
    write_csv(tmp_path / "whole.csv", [row(1, f, 1.0 * f, 0.0, 10.0) for f in range(1, 9)])
    table = csv.read_csv(tmp_path / "whole.csv").append_column("case_id", pa.array(["1"] * 8))
    at = table.column_names.index(column)
    rest = [value * k for k in range(1, 8)] if column == "timestamp_ms" else [1.0] * 7
    changed = table.set_column(at, column, pa.array([value if rest[0] == 1.0 else 0.0, *rest]))
    pq.write_table(changed, tmp_path / "changed.parquet")
    with pytest.raises(TrackError, match=rf"changed\.parquet: {message}$"):
        read_source(tmp_path / "changed.parquet")
