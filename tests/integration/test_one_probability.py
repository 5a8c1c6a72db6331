"""One P everywhere, rounded to what is known: in each place that tells it, on recordings of three sites."""

from __future__ import annotations

import json
import re
import shutil
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import scex_sumo
from scex_sumo.commands.answers import run_answer
from scex_sumo.metrics.events import EVENTS
from scex_sumo.page.report.contents import report_contents
from scex_sumo.reports.run_table import expected_injuries, print_summary
from scex_sumo.results.probability import Encounter
from scex_sumo.results.run import Run
from tests.command import scex
from tests.runs import extrapolate

SITES = {
    "k733": ("taf_bw/maps/k733_2020-09-15.osm", 80.1),
    "MONA": ("mona/MONA-Merge/C-DEU_MONAMerge-2_1200_T-1279.xml.gz", None),
    "NGSIM": ("ngsim/USA_Peach-3_2_T-1.xml.gz", None),
}


@pytest.fixture(scope="module", params=SITES)
def run(request: pytest.FixtureRequest, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """As few futures as can have tables. At MONA P of any collision is sampled, else it is exact."""
    map_file, time_s = SITES[request.param]
    scene = scex_sumo.read_seed(data / map_file, time=time_s)
    out = tmp_path_factory.mktemp(request.param) / "out"
    return extrapolate(scene, futures=60, world="plain", metrics=["gap", "pet"], out=out)


@pytest.fixture(scope="module")
def worst(run: Run) -> Encounter:
    """The pair that collides most often and has a table."""
    rows = [row for row in run.encounters.to_pylist() if row["collision"] > 0]
    found = [run.encounter(row["track_id"], row["other_id"]) for row in rows]
    return max((one for one in found if one.collision.known), key=lambda one: one.row["collision"])


def told(*words: object) -> str:
    done = scex(*words)
    assert done.returncode == 0, done.stderr
    return str(done.stdout)


def page_row(run: Run, one: Encounter) -> dict[str, Any]:
    contents, _ = report_contents(run)
    ids, rows = contents["track_ids"], contents["encounters"]["rows"]
    return next(row for row in rows if {ids[v] for v in row["pair"]} == set(one.pair))


def test_any_collision_is_the_same_in_each_place(run: Run, tmp_path: Path) -> None:
    again = shutil.copytree(run.folder, tmp_path / "again")
    said, console = run.collision.percent, Console(file=StringIO(), width=250)
    print_summary(run, console)
    summary = console.file.getvalue()  # type: ignore[attr-defined]
    share = run.collision.share.replace(" ", "")
    (line,) = (line for line in summary.splitlines() if line.startswith("│ collision"))
    assert f" {share} " in line
    assert f"a collision in {said} of futures" in summary and f"a collision in {said})" in repr(run)
    plotted = told("plot", run.folder, again, "-o", tmp_path / "both.svg")
    assert re.search(rf"^│ collision +│ +{re.escape(said)} │ +{re.escape(said)} │$", plotted, re.MULTILINE)
    answer = run_answer(run)["collision"]
    assert answer["words"]["stress_test"] == run.collision.words
    assert answer["stress_test"]["value"] == run.collision.estimate.value
    page, _ = report_contents(run)
    assert page["collision"]["percent"] == run.collision.share


def test_a_pair_is_the_same_in_each_place(run: Run, worst: Encounter) -> None:
    """Whichever way round it is asked for."""
    said, (one, other) = worst.collision.percent, worst.pair
    assert re.fullmatch(r"\d+ %", said)  # a remainder of 3/60 leaves no more
    pair = told("encounters", run.folder, "--pair", f"{other},{one}")
    assert f"collides in {said}, " in pair
    (line,) = (line for line in pair.splitlines() if line.startswith("│ collision"))
    assert line.split("│")[2].strip() == said
    arrow = f"{worst.row['track_id']} → {worst.row['other_id']}"
    listed = told("encounters", run.folder)
    (line,) = (line for line in listed.splitlines() if line.startswith(arrow))
    assert re.search(rf" {said} +exact ", line)
    row = page_row(run, worst)
    assert said in row["said"] and f"collides in {said}, " in row["words"]
    found = json.loads(told("encounters", run.folder, "--json"))["encounters"]
    (answer,) = (row for row in found if {row["track_id"], row["other_id"]} == set(worst.pair))
    assert answer["exact_collision"] == worst.collision.exact


def test_severe_injuries_are_those_of_1000_futures_in_each_place(run: Run) -> None:
    injuries = expected_injuries(run)
    assert injuries is not None
    said, console = f"{1000 * injuries:.2f}", Console(file=StringIO(), width=250)
    print_summary(run, console)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    (row,) = (line for line in lines if line.startswith("│ severe injuries [‰]"))
    assert f" {said} " in row
    assert report_contents(run)[0]["collision"]["injuries"] == pytest.approx(injuries)


def test_no_event_of_a_pair_is_rarer_than_its_collision(run: Run) -> None:
    for row in run.encounters.to_pylist():
        pair = run.encounter(row["track_id"], row["other_id"])
        for event in EVENTS:
            assert pair.probability(event).estimate.value >= pair.collision.estimate.value, (row, event)


def test_a_collision_that_counts_as_pet_is_said_to(run: Run, worst: Encounter) -> None:
    assert worst.row["pet"] >= worst.row["collision"] > 0
    pair = "{},{}".format(*worst.pair)
    assert "a collision counts as TTC, PET and DRAC" in told("encounters", run.folder, "--pair", pair)
    assert "a collision counts as TTC, PET and DRAC" in told("encounters", run.folder)
