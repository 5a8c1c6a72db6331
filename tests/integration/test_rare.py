"""Rare collisions of human-like drivers: reproducible, resumable, and shown beside the plain futures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import scex_sumo
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.extrapolation.extra import rare as rare_futures
from scex_sumo.extrapolation.job import Job, run_in_memory
from scex_sumo.extrapolation.models import ModelSet
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.extrapolation.workers import Workers
from scex_sumo.reports.encounter_rows import with_rare
from scex_sumo.results.rare import Rare, RarePair, probability_words
from scex_sumo.results.run import Run
from tests.exact.queues import queues
from tests.integration.test_cli import refused, scex

RARE = 40


def run_of(out: Path, **options: Any) -> Run:
    """Two pairs of cars; the first car of one of them brakes hard, closely ahead of the other."""
    given = {"models": "likely_driver", "children": 60, "world": "plain", "metrics": ["gap"], "rare": RARE}
    given["assign"] = {1: "emergency_brake"}
    return scex_sumo.extrapolate(queues(2, 2, gap_m=2.5), out=out, **given | options)


def job_of(run: Run) -> Job:
    """Return a job of one child of the run."""
    settings = RunSettings(
        models="likely_driver", children=1, world="plain", metrics=["gap"], assign={1: "emergency_brake"}
    )
    scene, models = queues(2, 2, gap_m=2.5), ModelSet.of(settings)
    assigned = models.draw(scene.track_ids, children=1, seed=0, design=settings.design)
    return Job(scene, run.net, settings, models, assigned, run.folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_of(tmp_path_factory.mktemp("rare") / "out")


def test_chosen_futures_stand_beside_the_plain_ones(run: Run, tmp_path: Path) -> None:
    assert run.rare is not None
    assert run.rare.count == 60 + RARE and run.rare.chosen > 0
    assert run.rare.simulated == 8 * RARE
    assert run.rare.low <= run.rare.value <= run.rare.high
    without = run_of(tmp_path / "without", rare=0)
    assert without.rare is None
    for table in ("tracks", "metrics", "assignments", "encounters", "collisions"):
        name = f"{table}.parquet"
        assert (run.folder / name).read_bytes() == (without.folder / name).read_bytes(), name


def test_a_future_with_a_collision_can_be_driven_again_from_its_draws(run: Run) -> None:
    assert run.rare is not None and run.rare.hits > 0
    rows = run.table("rare/futures.parquet").to_pylist()
    assert len(rows) == run.rare.hits
    assert sum(row["weight"] for row in rows) == pytest.approx(run.rare.value)
    assert all(len(row["draw"]) == 4 for row in rows)
    assert {tuple(row["chosen"]) for row in rows if row["chosen"]} == {(1, 2)}
    weights = [row["weight"] for row in rows]
    assert weights == sorted(weights, reverse=True)
    assert run.rare.expected_mais3 == pytest.approx(sum(row["weight"] * row["injuries"] for row in rows))
    assert 0 < run.rare.expected_mais3 < run.rare.value
    job = job_of(run)
    for row in rows[:: max(1, len(rows) // 3)]:
        part = run_in_memory(replace(job, route_draw=np.array([row["draw"]])), [0])
        for name in ("x", "y", "heading", "speed"):
            driven = getattr(part.states, name)[0].T.ravel()
            assert driven == pytest.approx(row[name], abs=1e-9), name


def test_a_rare_future_can_be_seen(run: Run) -> None:
    rows = run.table("rare/futures.parquet").to_pylist()
    file = Path(scex("view", run.folder, "--rare", len(rows), "--write-only").stdout.strip())
    assert file.name == f"child_{rows[-1]['future']:04d}.sumocfg" and file.is_file()
    view = ElementTree.parse(file.with_suffix(".view.xml")).getroot()
    stop = float(view.find("breakpoint").get("time"))  # type: ignore[union-attr, arg-type]
    assert 0 <= stop - 1.0 - rows[-1]["time_s"] < 0.1 + 1e-6
    for number in (0, len(rows) + 1):
        assert f"give 1 to {len(rows)}" in refused("view", run.folder, "--rare", number, status=2)
    assert "exclude" in refused("view", run.folder, "--rare", 1, "--child", 1, status=2)


def test_pairs_share_the_probability(run: Run) -> None:
    assert run.rare is not None
    assert {(pair.track_id, pair.other_id) for pair in run.rare.pairs} == {(1, 2)}
    # The first car has no random draws.
    assert not [cause for pair in run.rare.pairs for cause in pair.causes if cause.startswith("1 ")]
    values = [pair.value for pair in run.rare.pairs]
    assert values == sorted(values, reverse=True)
    assert run.rare.of(2, 1) == values[0] and run.rare.of(1, 3) == 0.0
    assert max(values) <= run.rare.value <= sum(values) + 1e-12
    assert run.rare.mostly() and run.p_collision.percent == run.rare.percent
    assert run.p_collision.best == run.rare
    row = {"track_id": 2, "other_id": 1, "collision": 0.5, "ttc": 0.25}
    assert with_rare(row, run.rare)["collision"] == values[0] and with_rare(row, None) == row


def test_workers_and_interruptions_change_no_byte(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    two = run_of(tmp_path / "two", workers=2)

    def interrupt(*_: object) -> Rare:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(rare_futures, "_described", interrupt)
        patched.setattr(rare_futures._Futures, "keep", interrupt)
        with pytest.raises(KeyboardInterrupt):
            run_of(tmp_path / "again")
    begun: list[int] = []
    original = Workers.run

    def counted(self: Workers, job: Any, batches: Any, **options: Any) -> Any:
        begun.extend(len(batch) for batch in batches)
        return original(self, job, batches, **options)

    monkeypatch.setattr(Workers, "run", counted)
    again = run_of(tmp_path / "again")
    assert not begun
    for other in (two, again):
        for name in ("rare.json", "rare/futures.parquet"):
            assert (other.folder / name).read_bytes() == (run.folder / name).read_bytes()
        assert [file.name for file in (other.folder / "rare").iterdir()] == ["futures.parquet"]


def test_other_models_and_frequent_collisions_have_no_rare_ones(tmp_path: Path) -> None:
    assert run_of(tmp_path / "rules", models="rules", children=5).rare is None
    assert run_of(tmp_path / "mixed", models="likely,constant_velocity", children=5).rare is None
    often = scex_sumo.extrapolate(
        queues(2, gap_m=2.0),
        models="likely_driver",
        assign={1: "emergency_brake"},
        children=20,
        world="plain",
        metrics=["gap"],
        rare=20,
        out=tmp_path / "often",
    )
    assert np.asarray(often.metrics["collision"]).sum() >= rare_futures.FREQUENT and often.rare is None


def test_the_command_looks_for_them_by_default(tmp_path: Path) -> None:
    osm = scex_sumo.example_path("motorway_merge")
    common = ("run", osm, "--synthetic", "4", "--children", "3", "--steps", "10", "--no-report")
    told = scex(*common, "--rare", "20", "-o", tmp_path / "out", "--json").stdout
    rare = json.loads(told)["collision"]["rare"]
    human = scex_sumo.open_run(tmp_path / "out").reference
    assert human is not None and human.rare is not None
    assert rare["count"] == human.rare.count == 117 + 20 and rare["hits"] == 0
    assert {row["rare_collision"] for row in json.loads(told)["encounters"]} <= {None, 0.0}
    assert rare["high"] == human.rare.high < 0.026
    report = scex("report", tmp_path / "out").stdout
    assert "report" in report
    page = (tmp_path / "out" / "report.html").read_text()
    assert "importance sampling, 0 collisions in 137 futures" in page
    assert "--rare: got -1" in refused(*common, "--rare", "-1", "-o", tmp_path / "bad", status=2)
    with pytest.raises(UsageError, match="--rare"):
        run_of(tmp_path / "many", rare=10**6)


def test_a_damaged_file_is_one_error(run: Run, tmp_path: Path) -> None:
    copy = run_of(tmp_path / "copy", rare=0, children=2)
    (copy.folder / "rare.json").write_text('{"pairs": [1]}')
    with pytest.raises(ResultError, match=r"rare\.json: cannot be read"):
        _ = scex_sumo.open_run(copy.folder).rare


def test_probabilities_in_words() -> None:
    words = [probability_words(value) for value in (0.0, 1.0, 0.5, 0.0123, 1e-3, 7.04e-5, 1.53e-4)]
    assert words == ["0 %", "100 %", "50 %", "1.2 %", "0.1 %", "7e-5", "1.5e-4"]
    share = {"value": 7e-5, "low": 3e-5, "high": 1.5e-4}
    pair = RarePair(track_id=7, other_id=8, share=0.9, hits=4, causes=("8 inattentive",), **share)
    other = RarePair(track_id=1, other_id=2, share=0.1, hits=1, **share)
    made = {
        "count": 700,
        "hits": 5,
        "chosen": 500,
        "expected_mais3": 2e-6,
        "simulated": 4000,
        **share,
    }
    found = Rare(pairs=(pair, other), **made)
    assert f"{found.percent}, {found.mostly()}" == "7e-5 (3e-5 – 1.5e-4), mostly 7 and 8, 8 inattentive"
    none = replace(found, value=0.0, low=0.0, high=0.021, hits=0, pairs=())
    assert none.percent == "less than 2.1 %"
    assert none.mostly() == "none in 4000 simulations of pairs that come near"
    assert replace(none, simulated=0).mostly() == ""
