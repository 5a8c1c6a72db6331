"""Options of every command: configuration files, JSON answers, and how much is said."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from scex_sumo import example_path
from scex_sumo.commands.json_output import plain
from tests.command import ALONE, scex

MAP = example_path("roundabout")
SHORT = ("--futures", 4, "--steps", 5)
DOCS = Path(__file__).parents[2] / "docs" / "json.md"


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run."""
    out = tmp_path_factory.mktemp("shared") / "out"
    assert scex("run", MAP, *SHORT, "-o", out, "--no-report").returncode == 0
    return out


def documented(command: str) -> list[str]:
    """Keys of an answer in the docs."""
    section = DOCS.read_text().partition(f"### {command}\n")[2].partition("\n#")[0]
    cells = re.findall(r"^- (`.+?`):", section, re.MULTILINE)
    return [key for cell in cells for key in re.findall(r"`(\w+)`", cell)]


@pytest.mark.parametrize("command", ["encounters", "validate", "inspect"])
def test_json_is_all_on_standard_output_and_has_the_documented_keys(
    command: str, result: Path, tmp_path: Path
) -> None:
    validated = (MAP, "--every", 9, "--futures", 4, "-o", tmp_path / "out")
    given = {"encounters": (result,), "validate": validated, "inspect": (MAP,)}[command]
    done = scex(command, *given, "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert list(answer) == documented(command)


def test_the_answer_of_a_run_is_its_result(result: Path) -> None:
    import scex_sumo

    again = scex("run", "--config", result / "run.json", "--json")
    answer: dict[str, Any] = json.loads(again.stdout)
    assert list(answer) == documented("run")
    run = scex_sumo.open_run(result)
    (ttc,) = [metric for metric in answer["metrics"] if metric["name"] == "ttc"]
    assert ttc["stress_test"]["value"] == run.p_critical("ttc").value
    assert run.reference is not None and ttc["human_like"]["value"] == run.reference.p_critical("ttc").value
    assert (ttc["threshold"], ttc["critical"]) == (run.thresholds["ttc"], "at least")  # 1/TTC
    rows = [row for row in answer["encounters"] if row["futures"] == "stress test"]
    found = {(row["track_id"], row["other_id"]): row for row in rows}
    for row in plain(run.encounters.to_pylist()):
        assert found[row["track_id"], row["other_id"]].items() >= row.items()


def test_a_file_gives_options_and_the_command_line_wins(tmp_path: Path) -> None:
    config = tmp_path / "run.toml"
    config.write_text(
        f'map = "{MAP}"\nfutures = 9\nsteps = 5\nmodels = ["standard_driver", "risky_driver"]\n'
        'report = false\nreference = "none"\nthreshold = {ttc = 0.25}\nassign = {3 = "risky_driver"}\n'
    )
    done = scex("run", "--config", config, "--futures", 3, "-o", tmp_path / "one")
    assert done.returncode == 0, done.stderr
    info = json.loads((tmp_path / "one" / "run.json").read_text())
    assert (info["futures"], info["steps"], info["thresholds"]["ttc"]) == (3, 5, 0.25)
    assert not (tmp_path / "one" / "report.html").exists()
    assert scex("run", "--config", tmp_path / "one" / "run.json", "-o", tmp_path / "two").returncode == 0
    for name in ("tracks.parquet", "metrics.parquet", "assignments.parquet"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_paths_of_a_file_are_relative_to_its_folder(tmp_path: Path) -> None:
    maps = tmp_path / "conf" / "maps"
    maps.mkdir(parents=True)
    for ending in (".osm", ".csv"):
        shutil.copy(MAP.with_suffix(ending), maps)
    text = f'map = "maps/{MAP.name}"\ntracks = "maps/{MAP.stem}.csv"\nout = "../result"\n'
    (tmp_path / "conf" / "run.toml").write_text(
        text + 'futures = 2\nsteps = 2\nreport = false\nreference = "none"\n'
    )
    done = scex("run", "--config", tmp_path / "conf" / "run.toml")
    assert done.returncode == 0, done.stderr
    command = json.loads((tmp_path / "result" / "run.json").read_text())["command"]
    assert command[-1] == str(maps / MAP.name)
    (tmp_path / "conf" / "run.toml").write_text(f'map = "{MAP.name}"\n')
    done = scex("run", "--config", tmp_path / "conf" / "run.toml")
    assert str(tmp_path / "conf" / MAP.name) in done.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("futureern = 3", "unknown key 'futureern'; nearest: futures"),
        ("report = 3", "report is 3, needs true or false"),
        ("futures = ", "Invalid value"),
    ],
)
def test_a_wrong_file_is_one_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text(text)
    done = scex("run", MAP, "--config", tmp_path / "x.toml")
    assert done.returncode == 2 and said in done.stderr and done.stderr.count("\n") == 1


def test_quiet_leaves_warnings_and_verbose_says_where_an_error_comes_from(tmp_path: Path) -> None:
    words = ("run", MAP, *SHORT, *ALONE, "--no-report", "-o")
    assert "note: " in scex(*words, tmp_path / "a", "--time", 0.5).stderr
    assert scex(*words, tmp_path / "b", "--time", 0.5, "-q").stderr == ""
    assert "Traceback" in scex("run", tmp_path / "none.osm", "-v").stderr


@pytest.mark.parametrize(
    ("option", "said"),
    [
        (("--under-test", "3=nope"), "unknown behavior 'nope'"),
        (("--time", "nan"), "--time"),
        (("--world", "plain", "--gui"), "--gui shows SUMO"),
        (("--world", "plain", "--models", "sumo:EIDM"), "driven by SUMO"),
        (("--reference", "nope"), "unknown behavior 'nope'"),
        (("-o", __file__), "is a file"),
    ],
)
def test_a_bad_option_is_found_before_a_recording_is_read(
    option: tuple[object, ...], said: str, tmp_path: Path
) -> None:
    done = scex("run", tmp_path / "none.osm", "--tracks", tmp_path / "none.csv", *option)
    assert done.returncode == 2 and said in done.stderr
