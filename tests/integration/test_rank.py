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

import pyarrow.parquet as pq
import pytest

import scex_sumo
from scex_sumo.base.errors import UsageError
from scex_sumo.studies.rank.rank import rank as rank_dataset
from tests.command import scex, started
from tests.commands.test_shared import documented
from tests.runs import extrapolate

MODELS = "standard_driver,constant_velocity,emergency_brake"
OPTIONS = ("--every", "4", "--futures", "6", "--top", "2", "--models", MODELS)


def rank(*arguments: object) -> subprocess.CompletedProcess[str]:
    return scex("rank", *arguments)


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
    assert "people: 1 in" in done.stdout and "roundabout" in done.stdout
    return out


@pytest.fixture(scope="module")
def answered(
    dataset: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[tuple[object, ...], dict[str, Any]]:
    """A ranking with one encounter on its page: its command, and what that says."""
    out = tmp_path_factory.mktemp("answered") / "out"
    words = (dataset, "--every", 4, "--futures", 4, "--top", 1, "--json", "-o", out)
    done = rank(*words)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert list(answer) == documented("rank")
    return words, answer


def test_the_table_has_a_row_for_every_seed_and_for_what_failed(result: Path) -> None:
    table = pq.read_table(result / "moments.parquet")
    assert sorted(table["time_s"].to_pylist()[:3]) == [4.1, 8.1, 12.1]
    assert table["seed"].to_pylist()[3] == "broken"
    assert "XML" in table["failure"].to_pylist()[3]
    info = json.loads((result / "rank.json").read_text())
    assert (info["seeds"], info["failed"]) == (3, 1)
    assert info["futures_run"] == 6 * len(info["shown"])


def test_an_encounter_is_a_pair_of_its_moment(result: Path) -> None:
    row = pq.read_table(result / "ranking.parquet").to_pylist()[0]
    assert (row["rank"], row["recording"]) == (1, "roundabout")
    seed = scex_sumo.read_seed(scex_sumo.example_path("roundabout"), time=row["time_s"])
    pairs = scex_sumo.moment_pairs(seed).to_pylist()
    (own,) = [
        one for one in pairs if (one["track_id"], one["other_id"]) == (row["track_id"], row["other_id"])
    ]
    assert {name: row[name] for name in own} == own
    assert row["stress_p_collision"] is not None


def test_a_verdict_of_the_page_is_read_again(
    answered: tuple[tuple[object, ...], dict[str, Any]], tmp_path: Path
) -> None:
    words, answer = answered
    first = answer["encounters"][0]
    key = ("recording", "case", "track_id", "other_id", "time_s")
    line = ",".join(str(first[name] or "") for name in key)
    (tmp_path / "t.csv").write_text(f"{','.join(key)},verdict,note\n{line},data error,no car\n")
    again = json.loads(rank(*words, "--triage", tmp_path / "t.csv").stdout)["encounters"]
    (judged,) = [row for row in again if row["note"]]
    assert (judged["verdict"], judged["note"], judged["rank"]) == ("data error", "no car", None)
    assert again[0]["rank"] == 1 and again[0]["how"] != first["how"]


def test_the_stress_test_of_the_top_is_that_of_a_run(
    answered: tuple[tuple[object, ...], dict[str, Any]], tmp_path: Path
) -> None:
    """Other moments have none."""
    _, answer = answered
    first, *others = answer["encounters"]
    assert {row["stress_p_collision"] for row in others if row["seed"] != first["seed"]} == {None}
    seed = scex_sumo.read_seed(scex_sumo.example_path("roundabout"), time=first["time_s"])
    run = extrapolate(seed, futures=4, out=tmp_path / "out")
    same = [row for row in answer["encounters"] if row["seed"] == first["seed"]]
    met = {frozenset((row["track_id"], row["other_id"])): row for row in run.encounters.to_pylist()}
    for row in same:
        own = met.get(frozenset((row["track_id"], row["other_id"])), {"collision": 0.0})
        assert row["stress_p_collision"] == own["collision"]


@pytest.mark.parametrize(
    ("bad", "note"),
    [("plan[0]", "12 of 168 plans replaced by"), ("plan", "no futures: lazy:lazy: no usable")],
)
def test_drivers_that_fail_are_noted(dataset: Path, tmp_path: Path, bad: str, note: str) -> None:
    """Vehicles stay where they are; the first one, or all, get no plan: at 6 times in 2 futures."""
    plan = f"    plan = np.zeros((len(history), 30, 2))\n    {bad}[...] = np.nan\n    return plan\n"
    (tmp_path / "lazy.py").write_text(f"import numpy as np\ndef lazy(history):\n{plan}")
    words = (dataset / "roundabout.osm", "--every", 9, "--futures", 2, "--top", 1, "--models", "lazy:lazy")
    done = scex("rank", *words, "-o", tmp_path / "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert note in done.stderr


def test_killed_in_the_middle_it_goes_on_to_the_same_bytes(
    dataset: Path, result: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = started("rank", dataset, *OPTIONS, "-o", out)
    deadline = time.monotonic() + 60
    while len(list(out.glob("pairs/*/*/*.parquet"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    assert process.wait().returncode == -signal.SIGKILL
    assert not (out / "rank.json").exists()
    done = rank(dataset, *OPTIONS, "-o", out, "--workers", 2)
    assert done.returncode == 0, done.stderr
    assert result_of(out) == result_of(result)


def test_ctrl_c_leaves_one_line_and_what_has_finished(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = [sys.executable, "-m", "scex_sumo", "rank", str(dataset), *OPTIONS, "-o", str(out)]
    process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not list(out.glob("pairs/*/*/*.parquet")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    (line,) = said.splitlines()
    assert line == f"interrupted; {out} keeps finished seeds; run the same command to go on"
    assert (out / "incomplete.json").exists()
    assert list(out.glob("pairs/*/*/*.parquet"))


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
    assert page.pictures == 3  # two encounters, and the map of the site
    reports = [link for link in page.links if not link.startswith("#")]
    assert len(reports) == 2 and "#encounter-1" in page.links
    for link in reports:
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
    assert run.info["seed_scene"]["name"] == shown


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"every": 0.0}, "--every"),
        ({"every": float("nan")}, "--every"),
        ({"futures": 0}, "--futures"),
        ({"triage": "nowhere.csv"}, "--triage"),
        ({"top": 0}, "--top"),
        ({"workers": 0}, "--workers"),
        ({"steps": 0}, "--steps"),
        ({"replan": 31}, "--replan"),
        ({"seed": -1}, "--seed"),
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
