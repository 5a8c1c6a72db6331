"""Critical responses as an extra of a run, in Python, and with a file of one's own."""

from __future__ import annotations

import dataclasses
import json
import math
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rich.console import Console

import scex_sumo as scex
from scex_sumo.certainty.response.answer import any_collision, once_in, responses_and_maps
from scex_sumo.certainty.response.critical import HARD_MPS
from scex_sumo.certainty.response.decision import pair_responses
from scex_sumo.certainty.response.people import SHIPPED, people_of
from scex_sumo.certainty.response.usual import AT_SITE
from scex_sumo.certainty.response.words import sentence
from scex_sumo.extrapolation.settings import RunSettings
from scex_sumo.reports.run_table import print_summary
from scex_sumo.results.extras import extras_results
from scex_sumo.results.tables.outcomes import injury_probability
from scex_sumo.scene import HISTORY_STEPS, Obstacles, States
from scex_sumo.steps.answers import run_answer
from scex_sumo.studies.moments.folder import MomentRef
from scex_sumo.studies.moments.run import MomentTask, pack_road
from scex_sumo.studies.rank.folder import run_moment
from scex_sumo.studies.rank.settings import RankSettings
from tests.queues import queues


def rows(scene: Any, **options: Any) -> list[dict[str, Any]]:
    return list(scex.critical_responses(scene, **options).to_pylist())


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> scex.Run:
    out = tmp_path_factory.mktemp("response") / "out"
    return scex.extrapolate(
        queues(2, gap_m=5.0),
        futures=4,
        models="standard_driver",
        world="plain",
        out=out,
        report=False,
    )


def test_a_run_writes_the_table_of_its_scene(run: scex.Run) -> None:
    table = run.table("response.parquet")
    (row,) = [row for row in table.to_pylist() if row["action"] == "brakes"]
    assert (row["track_id"], row["other_id"]) == (1, 2)
    # What is told is a part of the integral: the action at least so strong, and a response at least so late.
    assert 0 < row["frequency"] * row["later"] <= row["probability"] * (1 + 1e-9)
    assert row["probability_hard"] <= row["probability"]
    assert row["factor"] > 1 and row["doubt"] is None
    assert row["kind"] == "lane" and row["response_s"] < row["time_s"] <= 8.0
    equal_cars = 2 * injury_probability(np.array(max(row["delta_v"], HARD_MPS / 2)))
    assert row["expected_mais3"] == pytest.approx(row["probability_hard"] * equal_cars)


def test_the_summary_says_what_it_takes(run: scex.Run) -> None:
    lines = [line for extra in extras_results(run.folder) for line in extra.lines(run)]
    assert any("response times: a collision about once in" in line for line in lines)
    assert any("1 brakes with" in line and "2 responds later than" in line for line in lines)
    answer = run_answer(run)
    assert 0 < answer["response"]["collision"] < 1
    assert len(answer["response"]["pairs"]) == run.table("response.parquet").num_rows


def test_a_ranking_says_what_is_usual(run: scex.Run, tmp_path: Path) -> None:
    """20 encounters on lanes of the same site, all less probable; a pair has one place, whoever acts."""
    site = {"location": run.info["seed_scene"]["location"], "kind": "lane", "gap_m": 2.0, "doubt": None}
    others = [site | {"probability": k * 1e-9} for k in range(1, 21)]
    schema = pa.schema([("location", pa.string()), ("kind", pa.string()), ("gap_m", pa.float64())])
    schema = schema.append(pa.field("doubt", pa.string())).append(pa.field("probability", pa.float64()))
    pq.write_table(pa.Table.from_pylist(others, schema=schema), tmp_path / "ranking.parquet")
    beside = scex.extrapolate(
        queues(2, gap_m=5.0),
        futures=2,
        models="standard_driver",
        world="plain",
        out=tmp_path / "out",
        report=False,
        reference="none",
        usual=str(tmp_path),
    )
    found = beside.table("response.parquet").to_pylist()
    assert {(row["usual_rank"], row["usual_of"], row["usual_what"]) for row in found} == {(1, 21, AT_SITE)}
    assert found[0]["usual"] == pytest.approx(10.5e-9)
    assert (
        beside.decision is not None and "usual at this site: once in 100 000 000" in beside.decision.sentence
    )
    lines = [line for extra in extras_results(beside.folder) for line in extra.lines(beside)]
    assert any("× the median at this site, 1st of 21" in line for line in lines)


def test_the_summary_names_what_is_left_out(tmp_path: Path) -> None:
    scene = dataclasses.replace(queues(3, gap_m=5.0), recorded_steps=np.array([10, 10, 4]))
    options = {"futures": 2, "models": "standard_driver", "world": "plain", "report": False}
    run = scex.extrapolate(scene, reference=None, out=tmp_path / "out", **options)
    text = "\n".join(line for extra in extras_results(run.folder) for line in extra.lines(run))
    assert "  left out as doubtful: 3 is recorded for less than a second" in text
    assert "2 pairs of a queue, " not in text


def test_the_row_of_the_summary_has_the_digits_of_the_sentences(run: scex.Run) -> None:
    said = once_in(any_collision(run.table("response.parquet").to_pylist()))
    assert run_answer(run)["rows"]["people collide"] == [None, said]
    console = Console(file=StringIO(), width=200)
    print_summary(run, console)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    (row,) = (line for line in lines if line.startswith("│ people collide"))
    assert [cell.strip() for cell in row.split("│")[2:8]] == ["–", "–", "–", said, "–", "–"]
    assert any(f"a collision about {said} such moments" in line for line in lines)


def test_python_and_a_ranking_have_the_p_of_a_run(tmp_path: Path) -> None:
    """All know the rules of the road, which decide here whether a vehicle waits."""
    scene = scex.read_seed(scex.example_path("urban_intersection"), time=5.0)
    options = {"futures": 2, "models": "standard_driver", "report": False, "reference": None}
    told = scex.extrapolate(scene, out=tmp_path / "out", **options).table("response.parquet").to_pylist()
    assert rows(scene) == told
    assert responses_and_maps(scene, None)[0].to_pylist() != told  # without rules
    name = {"moment": "m", "location": "here", "recording": "r", "case": "", "time_s": 5.0, "vehicles": 9}
    task = MomentTask(
        ref=MomentRef(**name),
        scene=dataclasses.replace(scene, road=None),
        road=pack_road(scene.road),
        futures=range(0),
        settings=RankSettings(run=RunSettings(futures=2, models="standard_driver")),
    )
    pairs = run_moment(task)
    found = [one.probability for one in pair_responses(told)]
    assert pairs["probability"].to_pylist() == pytest.approx(found)


def test_none_leaves_it_out(tmp_path: Path) -> None:
    run = scex.extrapolate(
        queues(2),
        futures=2,
        models="standard_driver",
        world="plain",
        out=tmp_path / "out",
        report=False,
        reference="none",
        response="none",
    )
    assert not (run.folder / "response.parquet").exists()
    assert run_answer(run)["response"] is None


def test_a_closer_follower_collides_more_often() -> None:
    chances = [any_collision(rows(queues(2, gap_m=gap))) for gap in (4.0, 8.0, 16.0)]
    assert chances[0] > chances[1] > chances[2] >= 0


def test_a_vehicle_between_takes_the_place_of_the_responder() -> None:
    found = {(row["track_id"], row["other_id"]) for row in rows(queues(3, gap_m=5.0))}
    assert (1, 2) in found and (2, 3) in found and (1, 3) not in found


def test_people_who_respond_late_collide_more_often(tmp_path: Path) -> None:
    file = tmp_path / "late.json"
    shipped = json.loads(SHIPPED.read_text())["response_s"]["value"]
    file.write_text(json.dumps({"response_s": {name: 2 * median for name, median in shipped.items()}}))
    scene = queues(2, gap_m=5.0)
    assert any_collision(rows(scene, file=file)) > any_collision(rows(scene))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[", "cannot be read"),
        ("[]", "holds no object"),
        ('{"respons_s": 1}', "unknown name 'respons_s'; nearest: response_s"),
        ('{"decelerations": [1.0]}', "frequencies need 10 values"),
        ('{"growth": "much"}', "compare with response.json"),
    ],
)
def test_a_bad_file_is_refused(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "people.json"
    file.write_text(content)
    with pytest.raises(scex.ScexError, match=message):
        people_of(file)


def test_every_shipped_number_has_a_unit_or_says_how_it_was_counted_and_a_source() -> None:
    content = json.loads(SHIPPED.read_text())
    for name, entry in content.items():
        if name != "actions":
            assert entry["unit"] and entry["source"], name
    assert all(entry["source"] and entry["counted"] for entry in content["actions"].values())


def test_doubtful_encounters_are_marked_and_left_out_of_the_sentences() -> None:
    whole = queues(2, gap_m=5.0)
    short = dataclasses.replace(whole, recorded_steps=np.array([10, 4]))
    touching = queues(2, gap_m=-0.5)
    beside = queues(2, gap_m=5.0)
    moved = dataclasses.replace(beside.history, y=beside.history.y + 30.0)
    beside = dataclasses.replace(beside, history=moved)
    for scene, doubt in (
        (short, "2 is recorded for less than a second"),
        (touching, "1 and 2 overlap at the seed moment"),
        (queues(2, gap_m=1.0, speed=12.0), "1 and 2 nearly touch at the seed moment"),
        (beside, "1 is off the mapped lanes"),
    ):
        table = scex.critical_responses(scene)
        assert {row["doubt"] for row in table.to_pylist()} == {doubt}
        assert any_collision(table.to_pylist()) == 0 < any_collision(table.to_pylist(), doubtful=True)


def test_what_cannot_be_avoided_is_not_preventable() -> None:
    found = rows(scex.read_seed(scex.example_path("roundabout")))
    hopeless = [row for row in found if row["response_s"] == -math.inf]
    assert hopeless and not any(row["preventable"] for row in hopeless)
    assert any(row["preventable"] for row in found)


def test_a_person_beside_the_way_may_step_out() -> None:
    scene = queues(1, gap_m=5.0)
    still = np.ones((1, HISTORY_STEPS + 1))
    person = Obstacles(
        ids=("P7",),
        types=("pedestrian",),
        length=np.array([0.6]),
        width=np.array([0.6]),
        states=States(x=30 * still, y=3 * still, heading=0 * still, speed=0 * still),
        present=still > 0,
    )
    (row,) = rows(dataclasses.replace(scene, obstacles=person))
    assert (row["track_id"], row["person"], row["action"]) == (-1, "pedestrian P7", "steps out")
    assert row["doubt"] is None and 0 < row["probability"] < 1e-2
    (pair,) = pair_responses([row])
    assert pair.arrow.endswith("→ pedestrian P7")
    assert sentence([pair]).startswith("pedestrian P7 steps out within 2 s")
    # A pedestrian is injured by the impact speed; there is no occupant's curve for that.
    assert row["expected_mais3"] <= row["probability_hard"]
