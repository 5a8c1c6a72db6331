"""``scex-sumo rank`` as a user meets it: a whole folder of recordings, interrupted, wrong, and ranked."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset as pds
import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.certainty.results import exact_of
from scex_sumo.studies.rank.rank import rank as rank_dataset
from tests.command import scex, started
from tests.runs import extrapolate

MODELS = "standard_driver,constant_velocity,emergency_brake"
OPTIONS = ("--every", "4", "--first", "3", "--futures", "6", "--top", "2", "--models", MODELS)


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "scex_sumo", "rank", *map(str, arguments)]


def rank(*arguments: object) -> subprocess.CompletedProcess[str]:
    return scex("rank", *arguments)


def refused(*arguments: object, status: int = 1) -> str:
    done = rank(*arguments)
    assert done.returncode == status, (done.stdout, done.stderr)
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    return line


def result_of(folder: Path) -> dict[str, bytes]:
    """Every file of a ranking but the one that tells of times."""
    files = [f for f in sorted(folder.rglob("*")) if f.is_file() and f.name != "rank.json"]
    return {str(f.relative_to(folder)): f.read_bytes() for f in files}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of 18 s, and one whose map is none."""
    folder = tmp_path_factory.mktemp("dataset")
    source = scex_sumo.example_path("roundabout")
    for suffix in (".osm", ".csv"):
        shutil.copy(source.with_suffix(suffix), folder / f"roundabout{suffix}")
    shutil.copy(source.with_suffix(".csv"), folder / "broken.csv")
    (folder / "broken.osm").write_text("no map at all")
    return folder


@pytest.fixture(scope="module")
def result(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("rank") / "out"
    done = rank(dataset, *OPTIONS, "-o", out)
    assert done.returncode == 0, done.stderr
    (note,) = done.stderr.splitlines()
    assert note.startswith("note: broken: failed: ")
    assert "people collide" in done.stdout and "roundabout" in done.stdout
    return out


@pytest.fixture(scope="module")
def unstressed(
    dataset: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[tuple[object, ...], dict[str, Any]]:
    """A ranking that stresses its top encounter alone: its command, and what that says."""
    out = tmp_path_factory.mktemp("unstressed") / "out"
    words = (dataset, "--every", 4, "--futures", 4, "--top", 1, "--json", "-o", out)
    done = rank(*words)
    assert done.returncode == 0, done.stderr
    return words, json.loads(done.stdout)


def test_the_table_has_a_row_for_every_seed_and_for_what_failed(result: Path) -> None:
    table = pq.read_table(result / "moments.parquet")
    assert table["rank"].to_pylist() == [1, 2, 3, None]
    assert sorted(table["time_s"].to_pylist()[:3]) == [4.1, 8.1, 12.1]
    assert table["seed"].to_pylist()[3] == "broken"
    assert "XML" in table["failure"].to_pylist()[3]
    assert set(table["futures"].to_pylist()[:3]) <= {3, 6}
    info = json.loads((result / "rank.json").read_text())
    assert (info["seeds"], info["failed"]) == (3, 1)
    assert info["futures_run"] == sum(table["futures"].to_pylist())


def test_an_encounter_is_what_critical_responses_give(result: Path) -> None:
    row = pq.read_table(result / "ranking.parquet").to_pylist()[0]
    assert (row["rank"], row["recording"]) == (1, "roundabout")
    seed = scex_sumo.read_seed(scex_sumo.example_path("roundabout"), time=row["time_s"])
    both = {row["track_id"], row["other_id"]}
    rows = scex_sumo.critical_responses(seed).to_pylist()
    own = [one for one in rows if {one["track_id"], one["other_id"]} == both]
    assert row["probability"] == pytest.approx(1 - np.prod([1 - one["probability"] for one in own]))
    assert row["severity"] == pytest.approx(sum(one["expected_mais3"] for one in own))
    assert row["stress_p_collision"] is not None
    assert "brake in time" in row["takes"] or "responds later than" in row["takes"]


def test_without_first_futures_the_top_encounters_alone_are_stressed(
    unstressed: tuple[tuple[object, ...], dict[str, Any]],
) -> None:
    _, answer = unstressed
    assert sorted(row["futures"] for row in answer["moments"]) == [0, 0, 0, 4]
    first, *others = answer["encounters"]
    assert first["stress_p_collision"] is not None
    elsewhere = [row for row in others if row["seed"] != first["seed"]]
    assert {row["stress_p_collision"] for row in elsewhere} == {None}


def test_a_verdict_of_the_page_is_read_again(
    unstressed: tuple[tuple[object, ...], dict[str, Any]], tmp_path: Path
) -> None:
    words, answer = unstressed
    first = answer["encounters"][0]
    key = ("recording", "case", "track_id", "other_id", "time_s")
    line = ",".join(str(first[name] or "") for name in key)
    (tmp_path / "t.csv").write_text(f"{','.join(key)},verdict,note\n{line},data error,no car\n")
    again = json.loads(rank(*words, "--triage", tmp_path / "t.csv").stdout)["encounters"]
    (judged,) = [row for row in again if row["note"]]
    assert (judged["verdict"], judged["note"], judged["rank"]) == ("data error", "no car", None)
    assert again[0]["rank"] == 1 and again[0]["takes"] != first["takes"]


def test_a_row_is_what_run_gives(result: Path, tmp_path: Path) -> None:
    row = pq.read_table(result / "moments.parquet").to_pylist()[0]
    seed = scex_sumo.read_seed(scex_sumo.example_path("roundabout"), time=row["time_s"])
    run = extrapolate(seed, models=MODELS.split(","), futures=row["futures"], out=tmp_path / "out")
    for column in run.columns:
        samples = run.samples(column)
        assert row[f"median_{column}"] == (np.median(samples) if len(samples) else None)
    for column in run.thresholds:
        share = run.p_critical(column)
        assert (row[f"p_{column}_low"], row[f"p_{column}_high"]) == (share.low, share.high)
        assert row[f"p_{column}"] == share.value
    outcome = run.collision.estimate
    assert (row["p_collision"], row["p_collision_low"], row["p_collision_high"]) == (
        outcome.value,
        outcome.low,
        outcome.high,
    )


def test_the_futures_of_a_seed_are_what_its_row_counts(result: Path) -> None:
    futures = pds.dataset(result / "futures", partitioning="hive").to_table()
    table = pq.read_table(result / "moments.parquet")
    for row in table.to_pylist()[:3]:
        mine = futures.filter(pds.field("seed") == row["seed"])
        assert sorted(mine["future"].to_pylist()) == list(range(row["futures"]))
        assert {len(models) for models in mine["model"].to_pylist()} == {row["vehicles"]}


def test_killed_in_the_middle_it_goes_on_to_the_same_bytes(
    dataset: Path, result: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = started("rank", dataset, *OPTIONS, "-o", out)
    deadline = time.monotonic() + 60
    while len(list(out.glob("futures/*/*/*.parquet"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    assert process.wait().returncode == -signal.SIGKILL
    assert not (out / "rank.json").exists()
    done = rank(dataset, *OPTIONS, "-o", out, "--workers", 2)
    assert done.returncode == 0, done.stderr
    assert result_of(out) == result_of(result)


def test_ctrl_c_leaves_one_line_and_what_has_finished(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = subprocess.Popen(command(dataset, *OPTIONS, "-o", out), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not list(out.glob("futures/*/*/*.parquet")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    (line,) = said.splitlines()
    assert line == f"interrupted; {out} keeps finished seeds; run the same command to go on"
    assert (out / "incomplete.json").exists()
    assert list(out.glob("futures/*/*/*.parquet"))


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.pictures = 0
        self.links: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.pictures += tag == "svg" and ("class", "scene") in attrs
        for name, value in attrs:
            if name in ("src", "href") and value != "data:,":
                (self.links if tag == "a" else self.loaded).append(value or "")


def test_the_page_shows_the_top_and_loads_nothing(result: Path) -> None:
    text = (result / "ranking.html").read_text()
    page = _Page()
    page.feed(text)
    assert page.loaded == []
    assert page.pictures == 2
    assert len(page.links) == 2
    for link in page.links:
        report = (result / link).read_text()
        assert "Content-Security-Policy" in report and str(result) not in report
    for seed in json.loads((result / "rank.json").read_text())["shown"]:
        assert f'href="moments/{seed}.html"' in text
    assert "Failed" in text
    assert "$" not in text.split("<script>")[0]


def test_the_command_on_the_page_looks_at_the_same_moment(result: Path, tmp_path: Path) -> None:
    import html
    import shlex

    text = (result / "ranking.html").read_text()
    words = shlex.split(html.unescape(text.split("<code>")[1].split("</code>")[0]))
    words[words.index("-o") + 1] = str(tmp_path / "out")
    options = [*words[1:], "--futures", "3", "--no-plots"]
    scex(*options).check_returncode()
    run = scex_sumo.open_run(tmp_path / "out")
    shown = json.loads((result / "rank.json").read_text())["shown"][0]
    futures = pds.dataset(result / "futures", partitioning="hive").to_table()
    futures = futures.filter(pds.field("seed") == shown).sort_by("future").slice(0, 3)
    assert futures["wttc"].to_pylist() == run.metrics["wttc"].to_pylist()


def test_tracks_are_kept_of_the_futures_that_say_so(dataset: Path, result: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = rank(dataset, *OPTIONS, "--keep", "critical", "-o", out)
    assert done.returncode == 0, done.stderr
    futures = pds.dataset(out / "futures", partitioning="hive").to_table()
    tracks = pds.dataset(out / "tracks", partitioning="hive").to_table()
    kept = futures.filter(pds.field("kept"))
    pairs = zip(kept["seed"].to_pylist(), kept["future"].to_pylist(), strict=True)
    there = zip(tracks["seed"].to_pylist(), tracks["case_id"].to_pylist(), strict=True)
    assert set(pairs) == set(there)
    assert 0 < kept.num_rows <= 3 * 5
    assert (out / "ranking.csv").read_bytes() == (result / "ranking.csv").read_bytes()


def test_recordings_without_a_seed_are_refused_with_the_reason(dataset: Path, tmp_path: Path) -> None:
    line = refused(dataset, "--min-vehicles", 99, "-o", tmp_path / "out")
    assert "99 moving vehicles" in line
    assert "broken" not in line or "XML" in line


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"every": 0.0}, "--every"),
        ({"every": float("nan")}, "--every"),
        ({"futures": 0}, "--futures"),
        ({"first": -1}, "--first"),
        ({"by": "mixed"}, "--by"),
        ({"by": "stress_p_collision"}, "--first 32"),
        ({"triage": "nowhere.csv"}, "--triage"),
        ({"top": 0}, "--top"),
        ({"min_vehicles": 0}, "--min-vehicles"),
        ({"workers": 0}, "--workers"),
        ({"steps": 0}, "--steps"),
        ({"replan": 31}, "--replan"),
        ({"seed": -1}, "--seed"),
        ({"keep": "some"}, "none, critical, all"),
        ({"thresholds": {"speed": 3.0}}, "unknown metric 'speed'"),
        ({"models": "granny"}, "unknown behavior 'granny'"),
    ],
)
def test_options_that_make_no_sense_are_usage_errors(
    dataset: Path, tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        rank_dataset(dataset, out=tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_a_metric_of_ones_own_is_ranked_beside_the_others(dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "closeness.py").write_text(
        "import numpy as np, scex_sumo as scex\n"
        "@scex.metric('speed_gap', critical='max', unit='m/s', threshold=3.0)\n"
        "def speed_gap(scenes):\n"
        "    first, second = scenes.pairs\n"
        "    return scenes.unordered(np.abs(scenes.speed[second] - scenes.speed[first]))\n"
    )
    out = tmp_path / "out"
    words = (dataset, *OPTIONS, "--every", 9, "--metrics", "paper,closeness:speed_gap", "-o", out)
    done = scex("rank", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    table = pq.read_table(out / "moments.parquet")
    assert table["p_speed_gap"][0].as_py() == 1.0  # some drive 3 m/s faster than others in any future
    assert "median_wttc" in table.column_names and "median_gap" not in table.column_names


def test_an_exact_row_is_what_the_tables_of_a_run_give(tmp_path: Path) -> None:
    """A ranking of one moment is settled; of several, those whose rank is uncertain get tables."""
    words = ("--every", 2, "--to", 9, "--first", 32, "--futures", 192, "--top", 3, "--json")
    done = rank(scex_sumo.example_path("roundabout"), *words, "-o", tmp_path / "exact")
    assert done.returncode == 0, done.stderr
    rows = [row for row in json.loads(done.stdout)["moments"] if row["remainder"] is not None]
    rows = [row for row in rows if row["futures"] == 64]  # settled at once
    row = max(rows, key=lambda one: one["score"])
    assert 0 < row["p_collision"] == row["p_collision_low"] == row["p_collision_high"]
    assert (row["futures"], row["remainder"]) == (64, 3 / 64)
    assert 0 < row["extra"] <= 128
    seed = scex_sumo.read_seed(scex_sumo.example_path("roundabout"), time=row["time_s"])
    run = extrapolate(seed, futures=96, reference="none", response="none", out=tmp_path / "run")
    assert run.collision.exact == pytest.approx(row["p_collision"])
    tables = {
        key: table.probability() for key, table in exact_of(run).tables.items() if key[2] == "collision"
    }
    pair = (
        min(row["worst_track_id"], row["worst_other_id"]),
        max(row["worst_track_id"], row["worst_other_id"]),
    )
    assert row["worst_p_collision"] == pytest.approx(tables[(*pair, "collision")])
