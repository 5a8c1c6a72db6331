"""Exact probabilities of runs: against all assignments, by hand, and with the drawn futures unchanged."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import scex_sumo
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.certainty.results import exact_of, weighted_probability
from scex_sumo.certainty.weights import weighted
from scex_sumo.reports.run_table import print_summary
from scex_sumo.results.extras import known_percent
from scex_sumo.results.run import Run
from scex_sumo.scene import SeedScene
from tests.certainty.queues import queues
from tests.integration.test_cli import refused, scex
from tests.runs import extrapolate

RULES = "standard_driver,risky_driver,constant_velocity,emergency_brake"


def run_of(scene: SeedScene, out: Path, futures: int | str = 385, **options: Any) -> Run:
    return extrapolate(scene, futures=futures, world="plain", metrics=["gap"], out=out, **options)


@pytest.fixture(scope="module")
def roundabout(tmp_path_factory: pytest.TempPathFactory) -> Run:
    out = tmp_path_factory.mktemp("exact") / "out"
    # by hand: the ways of drivers without rules of the road
    return run_of(scex_sumo.read_seed(scex_sumo.example_path("roundabout")), out, rules=False)


def test_collisions_of_drivers_with_rules_are_exact(tmp_path: Path) -> None:
    run = run_of(scex_sumo.read_seed(scex_sumo.example_path("roundabout")), tmp_path / "out")
    assert run.collision.exact == pytest.approx(1 - 55 / 64 * (15 / 16) ** 2, abs=1e-15)


def test_the_example_has_the_probabilities_worked_out_by_hand(roundabout: Run) -> None:
    rear = roundabout.encounter(16, 15).collision
    assert rear.exact == rear.estimate.value == 1 / 16
    assert rear.known is not None and rear.known.ways == (
        "15 brakes hard (emergency_brake) and 16 keeps its speed (constant_velocity)",
    )
    assert roundabout.encounter(7, 11).collision.exact == 9 / 64
    assert roundabout.encounter(4, 6).collision.exact == 1 / 16
    # No pair shares a vehicle with another one.
    assert roundabout.collision.estimate.value == pytest.approx(1 - 55 / 64 * (15 / 16) ** 2, abs=1e-15)
    assert exact_of(roundabout) is not None and exact_of(roundabout).extra <= 385
    assert not exact_of(roundabout).sampled


def test_other_weights_follow_from_the_tables(roundabout: Run) -> None:
    assert weighted_probability(roundabout, {"standard_driver": 1.0}) == 0.0
    quarter = weighted_probability(roundabout, dict.fromkeys(RULES.split(","), 1.0))
    assert quarter == roundabout.collision.estimate.value
    alone = weighted_probability(roundabout, {15: {"emergency_brake": 1.0}}, pair=(16, 15))
    assert alone == 1 / 4
    with pytest.raises(UsageError, match="unknown event"):
        roundabout.encounter(16, 15).probability("hit")


def test_outcomes_of_each_pair_and_future_give_the_shares_of_the_encounters(roundabout: Run) -> None:
    table = roundabout.pair_outcomes
    ids = np.stack([np.asarray(table["track_a"]), np.asarray(table["track_b"])])
    assert (ids[0] < ids[1]).all()
    critical = {"ttc": ("min_ttc_path", -1.5), "pet": ("min_pet", -1.0), "drac": ("max_drac", 3.4)}
    hits = roundabout.collisions
    for row in roundabout.encounters.to_pylist():
        pair = np.sort([row["track_id"], row["other_id"]])
        hit = np.sort([np.asarray(hits["track_id"]), np.asarray(hits["other_id"])], axis=0) == pair[:, None]
        collides = set(np.asarray(hits["future"])[hit.all(axis=0)].tolist())
        mine = (ids == pair[:, None]).all(axis=0)
        for event, (column, limit) in critical.items():
            over = np.sign(limit) * np.asarray(table[column])[mine] > limit
            futures = collides | set(np.asarray(table["future"])[mine][over].tolist())
            assert len(futures) / roundabout.futures == pytest.approx(row[event], abs=1e-12), (row, event)
    assert (roundabout.folder / "pair_outcomes.parquet").stat().st_size < 200_000


def test_other_weights_without_tables_weight_the_drawn_futures(tmp_path: Path) -> None:
    """All 64 assignments of three vehicles: weighted, they give the exact value."""
    scene = queues(3)
    every = run_of(scene, tmp_path / "all", "all")
    drawn = run_of(scene, tmp_path / "drawn", 100)
    weights = {"emergency_brake": 0.5, "constant_velocity": 0.3}
    for row in every.encounters.to_pylist():
        pair = row["track_id"], row["other_id"]
        for event, value in weighted(every, pair, weights).items():
            exact = weighted_probability(drawn, weights, event, pair)
            assert value == pytest.approx(exact, abs=1e-12), (pair, event)
    assert weighted_probability(every, weights) == pytest.approx(
        weighted_probability(drawn, weights), abs=1e-12
    )
    # Two vehicles of one model are in 4 of the 64 assignments.
    with pytest.raises(UsageError, match="hardly any drawn future"):
        weighted_probability(every, {v: {"emergency_brake": 1.0} for v in (1, 2, 3)}, "ttc", (1, 2))
    nothing = dict.fromkeys(("collision", "ttc", "pet", "drac"))
    assert weighted(every, (1, 2), {"emergency_brake": 1.0}) == nothing


def test_the_terminal_says_the_same(roundabout: Run) -> None:
    weights = scex("encounters", roundabout.folder, "--weights", "standard_driver=0.9").stdout
    assert known_percent(weighted_probability(roundabout, {"standard_driver": 0.9}), 3 / 385) in weights
    pair = scex("encounters", roundabout.folder, "--pair", "15,16").stdout
    words = "15 brakes hard (emergency_brake) and 16 keeps its speed (constant_velocity)"
    assert words in pair and "none differs (remainder 0.8%)" in pair
    for given, reason in (("x=1", "unknown model 'x'"), ("standard_driver", "needs MODEL=WEIGHT")):
        assert reason in refused("encounters", roundabout.folder, "--weights", given, status=2)


def test_every_place_has_one_p_with_the_digits_that_the_remainder_leaves(roundabout: Run) -> None:
    """1 - 55/64 (15/16)² = 24.47 %, of which a remainder of 0.8 % leaves 24 %."""
    any_one, pair = roundabout.collision.percent, roundabout.encounter(7, 11).collision.percent
    assert (any_one, pair) == ("24 %", "14 %")
    console = Console(file=StringIO(), width=200)
    print_summary(roundabout, console)
    table = console.file.getvalue()  # type: ignore[attr-defined]
    assert "24%" in table and f"a collision in {any_one} of futures" in table
    assert f"a collision in {any_one}" in repr(roundabout)
    assert f"collides in {pair}" in scex("encounters", roundabout.folder, "--pair", "7,11").stdout


def test_a_pair_tells_its_own_remainder_and_a_table_that_failed_its_check_says_so(tmp_path: Path) -> None:
    run = run_of(queues(2, 2), tmp_path / "out", 100)
    file = run.folder / "exact.json"
    content = json.loads(file.read_text())
    (event,) = (e for e in content["events"] if (e["track_id"], e["event"]) == (1, "collision"))
    event["checked"] = 96
    content["events"] = [e for e in content["events"] if (e["track_id"], e["event"]) != (3, "collision")]
    why = "its table and a drawn future differ"
    content["sampled"] = [{"track_id": 3, "other_id": 4, "event": "collision", "why": why}]
    file.write_text(json.dumps(content))
    assert "checked on 96 futures: none differs (remainder 3.1%)" in told_of(run, "1,2")
    assert f"no exact table of the collision: {why}" in told_of(run, "3,4")


def told_of(run: Run, pair: str) -> str:
    return str(scex("encounters", run.folder, "--pair", pair).stdout)


@pytest.mark.parametrize(
    ("value", "remainder", "words"),
    [
        (0.5578, 0.0078, "56 %"),
        (0.0625, 0.0078, "6 %"),
        (1 / 256, 0.0078, "0.4 %"),
        (0.5578, 0.0009, "55.8 %"),
        (0.0, 0.0078, "0 %"),
        (1e-9, 0.0078, "< 0.01 %"),
        (1 - 1e-9, 0.0078, "> 99.99 %"),
        (1.0, 0.0078, "100 %"),
    ],
)
def test_digits_are_those_that_are_known(value: float, remainder: float, words: str) -> None:
    assert known_percent(value, remainder) == words


def test_a_whole_queue_counts(tmp_path: Path) -> None:
    """Whether the last car comes too close to the one before it hangs on all that brake or crash ahead."""
    run = run_of(queues(4), tmp_path / "out", 200)
    exact = exact_of(run)
    assert exact is not None
    table = exact.table(3, 4, "ttc")
    assert table is not None and table.track_ids == (1, 2, 3, 4)


def test_two_pairs_apart_do_not_count_for_each_other(tmp_path: Path) -> None:
    run = run_of(queues(2, 2), tmp_path / "out", 100)
    exact = exact_of(run)
    assert exact is not None
    tables = [exact.table(a, b) for a, b in ((1, 2), (3, 4))]
    assert [t.track_ids for t in tables if t is not None] == [(1, 2), (3, 4)]
    assert run.collision.estimate.value == 1 - (15 / 16) ** 2


def test_the_drawn_futures_stay_the_same_and_do_not_depend_on_the_workers(tmp_path: Path) -> None:
    scene = queues(4)
    runs = [
        run_of(scene, tmp_path / name, 100, exact=exact, workers=workers)
        for name, exact, workers in (("with", True, 1), ("two", True, 2), ("without", False, 1))
    ]
    assert exact_of(runs[2]) is None and exact_of(runs[0]) is not None
    for table in ("tracks", "metrics", "assignments", "encounters", "collisions"):
        one, *others = (run.folder / f"{table}.parquet" for run in runs)
        assert all(other.read_bytes() == one.read_bytes() for other in others), table
    assert runs[0].folder.joinpath("exact.json").read_bytes() == (
        runs[1].folder.joinpath("exact.json").read_bytes()
    )
    extra = runs[0].table("exact/assignments.parquet")
    assert np.asarray(extra["future"]).min() == 100 and extra.num_rows == 4 * exact_of(runs[0]).extra


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"models": ["a"], "shares": [1], "checked": 9, "extra": 1, "events": [{}]}']
)
def test_a_damaged_table_is_one_error(tmp_path: Path, content: str) -> None:
    run = run_of(queues(2), tmp_path / "out", 4)
    (run.folder / "exact.json").write_text(content)
    with pytest.raises(ResultError, match=r"exact\.json: cannot be read"):
        _ = exact_of(scex_sumo.open_run(run.folder))


def test_random_models_sumos_and_few_futures_keep_sampled_values(tmp_path: Path) -> None:
    scene = queues(2)
    assert exact_of(run_of(scene, tmp_path / "likely", 100, models="likely")) is None
    by_sumo = extrapolate(
        scene, futures=60, models="standard_driver,sumo:IDM", metrics=["gap"], out=tmp_path / "sumo"
    )
    assert exact_of(by_sumo) is None
    few = run_of(scene, tmp_path / "few", 20)
    assert exact_of(few) is None and few.collision.estimate.value == few.collision.sampled.value
    with pytest.raises(UsageError, match=r"1\.\d effective futures"):
        weighted_probability(few, {"risky_driver": 1.0})
