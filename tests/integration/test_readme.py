"""README: every command and every Python block of it runs as it stands there, with fewer futures."""

from __future__ import annotations

import csv
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

import scex_sumo as scex
from scex_sumo.base.sumo.programs import environment, program
from tests.command import scex as scex_sumo
from tests.command import script
from tests.conftest import shared_data
from tests.formats import test_argoverse, test_scenarionet
from tests.formats.levelx.levelx_files import Mover, write_highd
from tests.formats.levelx.test_dataset import intersection

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(kind: str) -> list[str]:
    """The fenced blocks of a kind."""
    return re.findall(rf"^```{kind}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


def rows(heading: str) -> dict[str, str]:
    """First cell and first command of each row of the table under a heading."""
    part = README.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    cells = [line.split("|")[1:3] for line in part.splitlines() if line.startswith("| ") and "`" in line]
    return {first.strip(): re.findall(r"`([^`]+)`", second)[0] for first, second in cells}


def command(text: str, where: Path, *more: str) -> str:
    """Run a command line of the README in a folder and return what it prints."""
    done = scex_sumo(*shlex.split(text, comments=True)[1:], *more, cwd=where)
    assert done.returncode == 0, (text, done.stdout, done.stderr)
    return done.stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder with the example seeds where a clone has them."""
    place = tmp_path / "scex_sumo" / "scenarios"
    shutil.copytree(ROOT / "scex_sumo" / "scenarios" / "data", place / "data")
    return tmp_path


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 140
    assert len([word for word in README.split() if re.search(r"\w", word)]) <= 900


def test_every_benchmark_has_a_line_in_their_readme() -> None:
    text = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+\.py)`", text))
    assert named == {path.name for path in (ROOT / "benchmarks").glob("*.py")}


def test_every_benchmark_starts() -> None:
    for name in ("gymnasium", "sklearn", "torch"):
        pytest.importorskip(name)
    code = """
import runpy, sys
sys.path.insert(0, "benchmarks")
for file in sys.argv[1:]:
    sys.argv = [file, "--help"]
    try:
        runpy.run_path(file, run_name="__main__")
    except SystemExit as stop:
        assert not stop.code, file
"""
    files = sorted((ROOT / "benchmarks").glob("*.py"))
    done = script(code, *files, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_the_make_targets_exist() -> None:
    targets = re.findall(r"`make (\w+)`", README)
    makefile = (ROOT / "Makefile").read_text()
    assert set(targets) == {"demo", "test"} and all(f"\n{target}:" in makefile for target in targets)


def test_the_commands_run_and_the_driver_drives(clone: Path) -> None:
    driver, code = blocks("python")
    (clone / "my_driver.py").write_text(driver)
    commands = [line for line in "\n".join(blocks("sh")).splitlines() if line.startswith("scex-sumo ")]
    first, second = commands
    assert first.endswith("-o out/roundabout")  # the next test runs it in full
    command(second, clone, "--futures", "3", "--no-report")
    assert "my_driver:Coasting" in (clone / "out" / "coasting" / "run.json").read_text()
    short = code.replace("futures=385", "futures=5")
    done = script(short, cwd=clone)
    assert done.returncode == 0, done.stderr
    assert "wttc_mean" in done.stdout and (clone / "out" / "python" / "run.json").is_file()


def test_the_answer_shown_is_that_of_the_command(clone: Path) -> None:
    (shown,) = blocks("text")
    (line,) = [line for line in "\n".join(blocks("sh")).splitlines() if line.endswith("-o out/roundabout")]
    said = command(line, clone, "--no-report")
    place = ("report: ", "result: ")
    printed = [row.rstrip() for row in said.splitlines() if not row.startswith(place)]
    assert [row for row in shown.splitlines() if not row.startswith(place)] == printed


def published_interaction(folder: Path) -> None:
    """The example roundabout in the folders of an INTERACTION download, v1.0 and v1.2."""
    for path in (folder / "maps", folder / "train", folder / "recorded_trackfiles" / "NAME"):
        path.mkdir(parents=True)
    example = scex.example_path("roundabout")
    shutil.copy(example, folder / "maps" / "NAME.osm")
    shutil.copy(
        example.with_suffix(".csv"), folder / "recorded_trackfiles" / "NAME" / "vehicle_tracks_000.csv"
    )
    with example.with_suffix(".csv").open() as file:
        recorded = list(csv.DictReader(file))
    with (folder / "train" / "NAME_train.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, ["case_id", *recorded[0]])
        writer.writeheader()
        for row in recorded:
            frame = int(row["frame_id"]) - 35  # the moment of the example becomes frame 10 of a case
            if 1 <= frame <= 40:
                writer.writerow({"case_id": 1, **row, "frame_id": frame, "timestamp_ms": 100 * frame})


def published_levelx(folder: Path) -> None:
    """Recordings of inD and highD as published, of a few vehicles in straight motion."""
    intersection(folder, [Mover(number=1, x=105.0, y=400.0, frames=126, speed=5.0)])
    shutil.copy(folder / "maps" / "lanelets" / "04" / "location4.osm", folder / "maps" / "MAP.osm")
    write_highd(
        folder / "data", [Mover(number=k, x=20.0 * k, y=-23.0, speed=25.0, frames=126) for k in (1, 2)]
    )


def simulated(folder: Path) -> None:
    """A configuration of a SUMO simulation."""
    net = {"check": True, "capture_output": True, "cwd": folder, "env": environment()}
    subprocess.run([program("netgenerate"), "--grid", "--grid.number", "3", "-o", "mine.net.xml"], **net)  # type: ignore[call-overload]
    flows = "".join(
        f'<flow id="{edge}" from="{edge}" to="{to}" begin="0" end="90" period="4"/>'
        for edge, to in (("A0A1", "C1C2"), ("C2C1", "A1A0"), ("A2B2", "C0B0"))
    )
    (folder / "mine.rou.xml").write_text(f"<routes>{flows}</routes>")
    files = '<net-file value="mine.net.xml"/><route-files value="mine.rou.xml"/>'
    (folder / "mine.sumocfg").write_text(f"<configuration><input>{files}</input></configuration>")


@pytest.mark.parametrize("dataset", rows("Your data"))
def test_the_command_of_each_dataset_runs_as_written(dataset: str, tmp_path: Path) -> None:
    text, data = rows("Your data")[dataset], shared_data()
    source = {"TAF-BW": "taf_bw", "CommonRoad": "ngsim"}.get(dataset)
    if source is not None:
        if data is None:
            pytest.skip("real maps and recordings are not here; set SCEX_DATA to their folder")
        for entry in (data / source).iterdir():
            (tmp_path / entry.name).symlink_to(entry)
    elif dataset.startswith("INTERACTION"):
        published_interaction(tmp_path)
    elif dataset == "Argoverse 2":
        (tmp_path / "log_map_archive_ID.json").write_text(json.dumps(test_argoverse.map_content()))
        parquet.write_table(pa.table(test_argoverse.columns()), tmp_path / "scenario_ID.parquet")
    elif dataset.startswith("ScenarioNet"):
        scenario = test_scenarionet.written(tmp_path, test_scenarionet.content())
        scenario.rename(tmp_path / "sd_waymo_ID.pkl")
    elif dataset.startswith("123D"):
        from tests.formats import test_py123d  # skips without msgpack

        test_py123d.write_map(tmp_path / "logs/SPLIT/LOG/map.arrow")
        test_py123d.write_log(tmp_path / "logs/SPLIT/LOG")
    elif dataset == "SUMO simulation":
        simulated(tmp_path)
    elif "D" in dataset:
        published_levelx(tmp_path)
    else:
        shutil.copy(scex.example_path("roundabout"), tmp_path / "MAP.osm")
    if dataset != "SUMO simulation":
        text = re.sub(r" --time \d+", "", text)  # the files of the test have less than a minute
    command(text, tmp_path, "--futures", "3", "--no-report", "--reference", "none")
    (out,) = (tmp_path / "out").iterdir()
    assert (out / "run.json").is_file()


def test_the_other_commands_exist_with_these_options() -> None:
    for text in rows("Other commands").values():
        name = shlex.split(text)[1]
        options = [word for word in shlex.split(text) if word.startswith("--")]
        shown = command(f"scex-sumo {name} --help", ROOT)
        assert all(option in shown for option in options), (text, shown)
