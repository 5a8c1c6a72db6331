"""One P everywhere: the share of the drawn futures in each place that tells it, on three recordings."""

from __future__ import annotations

import html
import json
import re
import shutil
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import scex_sumo
from scex_sumo.metrics.events import EVENTS
from scex_sumo.page.report.contents import report_contents
from scex_sumo.reports.card import any_cells
from scex_sumo.reports.run_table import expected_injuries, print_details
from scex_sumo.results.run import Run
from scex_sumo.results.tables.cut_sets import cut_set_words
from scex_sumo.results.tables.encounters import Encounter
from scex_sumo.steps.answers import run_answer
from tests.command import scex
from tests.runs import extrapolate

SITES = {
    "k733": ("taf_bw/maps/k733_2020-09-15.osm", 80.1),
    "MONA": ("mona/MONA-Merge/C-DEU_MONAMerge-2_1200_T-1279.xml.gz", None),
}


@pytest.fixture(scope="module", params=SITES)
def run(request: pytest.FixtureRequest, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    map_file, time_s = SITES[request.param]
    scene = scex_sumo.read_seed(data / map_file, time=time_s)
    out = tmp_path_factory.mktemp(request.param) / "out"
    return extrapolate(scene, futures=150, world="plain", metrics=["gap", "pet"], out=out)


@pytest.fixture(scope="module")
def worst(run: Run) -> Encounter:
    """The pair that collides most often."""
    row = run.encounters.to_pylist()[0]
    assert row["collision"] > 0 and row["cut_sets"]
    return run.encounter(row["track_id"], row["other_id"])


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
    print_details(run, console)
    summary = console.file.getvalue()  # type: ignore[attr-defined]
    share = run.collision.share.replace(" ", "")
    (line,) = (line for line in summary.splitlines() if line.startswith("│ collision"))
    assert f" {share} " in line and f" {run.collision.range} " in line
    assert f"a collision in {said} of futures" in summary and f"a collision in {said})" in repr(run)
    plotted = told("plot", run.folder, again, "-o", tmp_path / "both.svg")
    assert re.search(rf"^│ collision +│ +{re.escape(said)} │ +{re.escape(said)} │$", plotted, re.MULTILINE)
    answer = run_answer(run)["collision"]
    assert answer["words"]["stress_test"] == said
    assert answer["stress_test"]["value"] == run.collision.value
    assert report_contents(run)[0]["pairs"]["foot"][-2] == any_cells(run)[3]


def test_a_pair_is_the_same_in_each_place(run: Run, worst: Encounter) -> None:
    """Whichever way round it is asked for."""
    share, (one, other) = worst.collision, worst.pair
    always = cut_set_words(worst.row)
    pair = told("encounters", run.folder, "--pair", f"{other},{one}")
    assert f"collides in {share.percent}, {always[0]}" in pair
    assert all(f"collides {words}" in pair for words in always)
    (line,) = (line for line in pair.splitlines() if line.startswith("│ collision"))
    assert [cell.strip() for cell in line.split("│")[2:4]] == [share.share, f"{share.range} %"]
    arrow = f"{worst.row['track_id']} → {worst.row['other_id']}"
    (line,) = (line for line in told("encounters", run.folder).splitlines() if line.startswith(arrow))
    assert f" {share.share} " in line and f" {share.range} % " in line
    row = page_row(run, worst)
    assert share.share in row["said"] and f"collides in {share.percent}, {always[0]}" in row["words"]
    found = json.loads(told("encounters", run.folder, "--json"))["encounters"]
    (answer,) = (row for row in found if {row["track_id"], row["other_id"]} == set(worst.pair))
    assert answer["collision"] == share.value == worst.happens("collision").mean()
    assert answer["cut_sets"] == worst.row["cut_sets"]


def test_sumo_gui_names_the_share_of_a_pair(run: Run, worst: Encounter) -> None:
    told("view", run.folder, "--write-only", "--encounter", "{},{}".format(*worst.pair))
    files = [file.read_text() for file in (run.folder / "sumo").rglob("*.xml")]
    said = f"collides in {worst.collision.share}".replace(" ", "\u00a0")
    assert any(said in html.unescape(text) for text in files)


def test_severe_injuries_are_those_of_1000_futures(run: Run) -> None:
    injuries = expected_injuries(run)
    assert injuries is not None
    said, console = f"{1000 * injuries:.2f}", Console(file=StringIO(), width=250)
    print_details(run, console)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    (row,) = (line for line in lines if line.startswith("│ severe injuries [‰]"))
    assert f" {said} " in row


def test_a_collision_that_counts_as_pet_is_said_to(run: Run, worst: Encounter) -> None:
    assert all(worst.row[event] >= worst.row["collision"] > 0 for event in EVENTS)
    pair = "{},{}".format(*worst.pair)
    assert "a collision counts as TTC, PET and DRAC" in told("encounters", run.folder, "--pair", pair)
    assert "a collision counts as TTC, PET and DRAC" in told("encounters", run.folder)
