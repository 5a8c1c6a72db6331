"""Futures with and without a driving function, compared one by one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.evaluation.tables import evaluate_pairs
from scex_sumo.extrapolation.settings import read_under_test
from scex_sumo.metrics.evaluate import evaluate
from scex_sumo.metrics.registry import COLUMNS
from scex_sumo.page.document import Document
from scex_sumo.page.report.under_test import under_test_part
from scex_sumo.reports.under_test import own_encounters, under_test_rows, under_test_table, verdict
from scex_sumo.results.run import Run
from scex_sumo.results.tables.encounters import QUESTIONS, SCHEMA
from scex_sumo.results.under_test import UnderTest
from tests.metrics.scenes import random_run


def test_vehicles_under_test_are_read_with_and_without_a_model() -> None:
    assert read_under_test(("17=acc:Acc:time_gap=2", "23")) == {17: "acc:Acc:time_gap=2", 23: None}
    for entries, words in (
        (("=acc:Acc",), "--under-test =acc:Acc: needs TRACK=MODEL, e.g. --under-test 17=emergency_brake"),
        (("17=",), "needs TRACK=MODEL"),
        (("17=replay", "17"), "--under-test 17: vehicle 17 is given twice"),
        (("17=replay", "17=replay"), "vehicle 17 is given twice; give it one model"),
    ):
        with pytest.raises(UsageError, match=words):
            read_under_test(entries)


def test_metrics_of_one_vehicle_are_the_extrema_of_its_own_pairs() -> None:
    tracks, planned = random_run(np.random.default_rng(5), futures=3)
    own = evaluate(tracks, planned, vehicles=[2])
    pairs = evaluate_pairs(tracks, planned)
    for name, worst in (("distance", np.min), ("wttc", np.min)):
        rows = pairs[name]
        involved = (rows.vehicle == 2) | (rows.other == 2)
        column, defined = own.column(name)
        for future in range(len(column)):
            mine = rows.value[involved & (rows.future == future)]
            assert defined[future] == (len(mine) > 0)
            if len(mine):
                assert column[future] == worst(mine)
    alone, _ = own.column("tq")
    rows = pairs["tq"]
    assert alone[0] == rows.value[(rows.vehicle == 2) & (rows.future == 0)].max()


Columns = dict[str, list[float | None]]


def folder_of(path: Path, tested: Columns, baseline: Columns) -> Run:
    """A result folder with values under test; columns that are not given are null."""

    def write(folder: Path, values: Columns, vehicles: dict[str, str | None]) -> None:
        folder.mkdir(parents=True)
        count = len(next(iter(values.values())))
        columns = {c: pa.array(values.get(c, [None] * count), pa.float64()) for c in COLUMNS}
        pq.write_table(pa.table({"future": list(range(count)), **columns}), folder / "under_test.parquet")
        metrics = {"future": list(range(count)), "collision": [False] * count}
        pq.write_table(pa.table(metrics), folder / "metrics.parquet")
        hits = {
            "future": [0, 0, 3],
            "track_id": [17, 8, 9],
            "other_id": [9, 9, 8],
            "consequence": [False] * 3,
        }
        hits |= {"p_mais3": [0.1, 0.5, 0.5], "p_mais3_other": [0.02, None, 0.5], "consequence": [False] * 3}
        pq.write_table(pa.table(hits).slice(0 if vehicles["17"] else 1), folder / "collisions.parquet")
        info = {
            "under_test": vehicles,
            "thresholds": {"distance": 5.0, "ttc": 0.5},
            "seed_scene": {"name": "drawn"},
            "futures": count,
        }
        (folder / "run.json").write_text(json.dumps(info))

    write(path, tested, {"17": "mypkg:MyDriver"})
    write(path / "baseline", baseline, {"17": None})
    return Run(path)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return folder_of(
        tmp_path / "out",
        {"distance": [4.0, 6.0, 3.0, 9.0, None], "ttc": [0.6, 0.0, 0.6, 0.1, 0.2]},
        {"distance": [8.0, 6.0, 7.0, 4.0, 2.0], "ttc": [0.1, 0.0, 0.1, 0.1, 0.2]},
    )


def test_futures_are_compared_one_by_one(run: Run) -> None:
    found = UnderTest.of(run).difference("distance")
    assert (found.under_test, found.baseline) == (5.0, 6.0)
    assert (found.futures, found.worse, found.better) == (4, 2, 1)
    assert (found.newly_critical, found.no_longer_critical) == (2, 1)
    assert found.critical_p_value == 1.0
    assert found.p_critical is not None and found.baseline_p_critical is not None
    assert (found.p_critical.value, found.baseline_p_critical.value) == (0.4, 0.4)  # of all five


def test_table_and_report_show_every_metric(run: Run) -> None:
    table = under_test_table(UnderTest.of(run))
    assert table.title == "under test, vehicle 17: mypkg:MyDriver: 5 futures"
    assert table.row_count == 2 + 6
    assert list(map(str, table.columns[3].cells)) == ["1 : 0", "1 : 0", "2 : 1", "–", "–", "–", "–", "2 : 0"]
    assert [list(map(str, table.columns[k].cells))[:3] for k in (5, 6)] == [
        ["0.0%", "–", "40.0%"],
        ["20.0%", "–", "40.0%"],
    ]
    # Of five futures one has a collision of vehicle 17, with 0.12 severe injuries; others' do not count.
    assert [str(list(table.columns[k].cells)[1]) for k in (1, 2)] == ["0.00", "24.00"]
    assert under_test_table(UnderTest.of(run), ["ttc"]).row_count == 3
    page, rows = Document("page"), under_test_rows(UnderTest.of(run))
    assert "vehicle 17: mypkg:MyDriver" in under_test_part(page, run)[1]
    curves = page.info["tested_curves"]
    assert len(curves) == 6 and sum(not curve["sets"] for curve in curves) == 4
    distance = curves[0]
    assert [(s["kind"], s["values"]) for s in distance["sets"]] == [
        (kind, UnderTest.of(run).samples("distance", driven).tolist())
        for kind, driven in (("picked", "under_test"), ("drawn", "baseline"))
    ]
    assert [row[3] for row in rows] == ["1 : 0", "1 : 0", "2 : 1", None, None, None, None, "2 : 0"]
    assert [row[6] for row in rows][:3] == [0.2, None, 0.4]
    assert [share for row in rows for share in row[5:7]].count(0.4) == 3


def test_the_verdict_says_whether_the_driver_is_better(tmp_path: Path) -> None:
    """Twenty futures; the distance is worse in each, 1/TTC as before, or better."""
    near, far = [3.0] * 20, [8.0 + 0.1 * k for k in range(20)]
    for number, (values, words) in enumerate(
        (
            ({"distance": near, "ttc": near}, "verdict: worse (worse in distance; p < 0.05)"),
            ({"distance": far, "ttc": near}, "verdict: no difference shown"),
            (
                {"distance": near, "ttc": [1.0] * 20},
                "verdict: mixed (better in 1/TTC; worse in distance; p < 0.05)",
            ),
        )
    ):
        run = folder_of(tmp_path / str(number), values, {"distance": far, "ttc": near})
        said = verdict(UnderTest.of(run))
        assert said.startswith(
            "under test, vehicle 17: mypkg:MyDriver, as drawn → under test: collides in 0 % [0–16]"
        )
        assert said.endswith(f"severe injuries per 1000 0.00 → 6.00; {words}")


def test_the_vehicles_own_encounters_are_told_before_and_after(run: Run) -> None:
    usual = {"time_s": 1.0, "future": 0, "gap": 2.0, "gap_p05": 2.0, "model": "m", "other_model": "o"}
    for folder, share in ((run.folder, 0.5), (run.folder / "baseline", 0.0)):
        event = {q: 0.0 for question in QUESTIONS for q in (question, f"{question}_low", f"{question}_high")}
        event |= {"collision": share, "critical": share, "collision_low": share, "collision_high": share}
        pairs = ((17, 9, event), (8, 9, event), (17, 8, event | {"collision": 0.0, "critical": 0.0}))
        rows = [usual | shares | {"track_id": a, "other_id": b} for a, b, shares in pairs]
        pq.write_table(pa.Table.from_pylist(rows, schema=SCHEMA), folder / "encounters.parquet")
    assert own_encounters(Run(run.folder)) == ["17 → 9 (1.0 s): collides in 0.0 % → 50.0 %"]


def test_a_run_without_vehicles_under_test_or_baseline_says_so(run: Run) -> None:
    (run.folder / "baseline" / "run.json").unlink()
    with pytest.raises(ResultError, match="its baseline was not run; run again"):
        _ = UnderTest.of(run)
    (run.folder / "run.json").write_text("{}")
    with pytest.raises(ResultError, match="no vehicle is under test; run with --under-test TRACK=MODEL"):
        _ = UnderTest.of(Run(run.folder))
