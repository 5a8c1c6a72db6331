"""What a run says of who hits and meets whom, and that what really happened is measured like a future."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.results.run import Run, open_run
from scex_sumo.results.tables.encounters import QUESTIONS
from tests.integration.test_cli import ALONE, ROUNDABOUT, refused, scex
from tests.runs import extrapolate


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("run") / "out"
    done = scex("run", ROUNDABOUT, "--futures", 40, *ALONE, "-o", out)
    assert done.returncode == 0, done.stderr
    assert "stress test" in done.stdout
    return scex_sumo.open_run(out)


def test_collisions_encounters_and_shares_say_the_same(run: Run) -> None:
    hit = np.asarray(run.metrics["collision"])
    assert set(run.collisions["future"].to_pylist()) == set(np.flatnonzero(hit).tolist())
    share = run.collision
    assert 0 < share.low < share.value == hit.mean() < share.high < 1
    assert max(row["collision"] for row in run.encounters.to_pylist()) <= share.value
    first = run.encounters.to_pylist()[0]
    together = {
        row["future"]
        for row in run.collisions.to_pylist()
        if {row["track_id"], row["other_id"]} == {first["track_id"], first["other_id"]}
    }
    assert first["collision"] == len(together) / 40


def test_outcomes_of_each_pair_and_future_give_the_shares_of_the_encounters(run: Run) -> None:
    table = run.pair_outcomes
    assert (np.asarray(table["track_a"]) < np.asarray(table["track_b"])).all()
    for row in run.encounters.to_pylist():
        encounter = run.encounter(row["track_id"], row["other_id"])
        for event in QUESTIONS:
            share = encounter.probability(event)
            assert encounter.happens(event).sum() == share.count == round(row[event] * run.futures), event
            assert share.value >= encounter.collision.value  # a collision counts as each event
    for answer in (encounter.probability, encounter.happens):
        with pytest.raises(UsageError, match="unknown event"):
            answer("hit")


def test_what_happens_to_a_vehicle_that_the_run_does_not_have_is_no_other_pairs(
    run: Run, tmp_path: Path
) -> None:
    edited = open_run(shutil.copytree(run.folder, tmp_path / "out"))
    known = edited.info["seed_scene"]["track_ids"]
    unknown = next(track for track in range(min(known), max(known) + 2) if track not in known)
    outcomes = edited.pair_outcomes
    tracks = pa.array([unknown, *outcomes["track_b"].to_pylist()[1:]])
    at = outcomes.column_names.index("track_b")
    pq.write_table(outcomes.set_column(at, "track_b", tracks), edited.folder / "pair_outcomes.parquet")
    first = edited.encounters.to_pylist()[0]
    with pytest.raises(ResultError, match="a pair has a vehicle that run"):
        open_run(edited.folder).encounter(first["track_id"], first["other_id"]).happens("critical")


def test_encounters_are_listed_and_a_pair_is_told_in_full(run: Run) -> None:
    first = run.encounters.to_pylist()[0]
    listed = scex("encounters", run.folder)
    assert f"{first['track_id']} \u2192 {first['other_id']}" in listed.stdout
    pair = scex("encounters", run.folder, "--pair", f"{first['other_id']},{first['track_id']}")
    assert "collides in futures" in pair.stdout and "by the model of one vehicle" in pair.stdout
    assert "needs two vehicles" in refused("encounters", run.folder, "--pair", "17", status=2)
    assert "meet in no future" in refused("encounters", run.folder, "--pair", "98,99", status=2)


def test_futures_of_replay_are_the_recorded_row(tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(ROUNDABOUT)
    assert scene.future_valid is not None and scene.future_valid[:, :30].all()  # all recorded to the end
    run = extrapolate(scene, models="replay", futures=2, out=tmp_path / "out")
    assert run.recorded is not None and run.info["recorded"] == {"left": {}, "overlaps": []}
    for column in run.columns:
        recorded = run.recorded_value(column)
        for value in run.values(column):
            assert (recorded is None) == np.isnan(value), column
            assert recorded is None or value == pytest.approx(recorded, rel=1e-6, abs=1e-9), column


def test_presets_choose_the_columns(tmp_path: Path) -> None:
    scene = scex_sumo.read_seed(ROUNDABOUT)
    path = extrapolate(scene, metrics="path", futures=3, out=tmp_path / "path")
    assert path.columns[:2] == ["gap", "gap_mean"] and len(path.columns) == 14
    paper = extrapolate(scene, metrics="paper", futures=3, out=tmp_path / "paper")
    assert len(paper.columns) == 12
    assert "unknown metric 'lane'" in refused("run", ROUNDABOUT, "--preset", "lane", status=2)
