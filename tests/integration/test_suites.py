"""``scex-sumo catalogue`` and ``scex-sumo test`` as a user meets them: made, opened, tested, wrong."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

import scex_sumo as scex
from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.studies.moments.folder import Failure
from scex_sumo.studies.moments.run import attempt
from scex_sumo.suites.drive import drive
from scex_sumo.suites.testing.suite_test import run_case, task_of
from tests.command import scex as command

FUNCTIONS = '''
import time

import numpy as np

import scex_sumo as scex


class Straight:
    """Goes straight on."""

    def plan(self, history, road, who, rng):
        now = history.now[who.future, who.vehicle]
        way = 0.1 * now.speed[:, None] * np.arange(1, 31)
        x, y = (v[:, None] + way * f(now.heading)[:, None] for v, f in ((now.x, np.cos), (now.y, np.sin)))
        whole = np.ones_like(way)
        return scex.Plan(x=x, y=y, heading=now.heading[:, None] * whole, speed=now.speed[:, None] * whole)


class Nan(Straight):
    def plan(self, history, road, who, rng):
        made = super().plan(history, road, who, rng)
        made.x[:] = np.nan if history.step else made.x
        return made


class Short(Straight):
    def plan(self, history, road, who, rng):
        made = super().plan(history, road, who, rng)
        if history.step < 10:
            return made
        parts = {name: getattr(made, name)[:, :3] for name in ("x", "y", "heading", "speed")}
        return scex.Plan(**parts)


class Slow(Straight):
    def plan(self, history, road, who, rng):
        if history.step:
            time.sleep(60)
        return super().plan(history, road, who, rng)


class Crash(Straight):
    def plan(self, history, road, who, rng):
        if history.step:
            raise RuntimeError("no route")
        return super().plan(history, road, who, rng)
'''


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a suite of two cases, of a recording that is not there any more, and functions."""
    folder = tmp_path_factory.mktemp("suites")
    source = Path(scex.example_path("urban_intersection"))
    (folder / "recordings").mkdir()
    for file in (source.with_suffix(".osm"), source.with_suffix(".csv")):
        shutil.copyfile(file, folder / "recordings" / file.name)
    done = command("catalogue", folder / "recordings", "--count", "2", "--every", "9", "-o", folder / "suite")
    assert done.returncode == 0, done.stderr
    assert "cases for" in done.stdout
    shutil.rmtree(folder / "recordings")
    shutil.rmtree(folder / "suite" / "ranking")
    (folder / "functions.py").write_text(FUNCTIONS)
    yield folder


def run(place: Path, *arguments: object) -> Any:
    return command("test", place / "suite", *arguments, cwd=place)


def read(place: Path, out: str) -> dict[str, Any]:
    return dict(json.loads((place / out / "test.json").read_text()))


def test_a_suite_opens_without_the_recordings(place: Path) -> None:
    suite = scex.open_suite(place / "suite")
    for case in suite.cases:
        scene, people = case.scene(), case.content["people"]
        assert scene.rules is not None and len(scene.rules.passages) > 0
        track, other = (case.content[name]["track_id"] for name in ("function", "other"))
        found = drive(scene, track, None, 64, seed=0).row_of(other)
        assert (found["how"], found["future"]) == (people["how"], people["future"])
        assert found["needed_braking"] == pytest.approx(people["needed_braking"], rel=1e-9)
    assert {row["kind"] for row in suite.info["exposure"]} >= {case.about["kind"] for case in suite.cases}
    assert (place / "suite" / "LICENCE.md").read_text().count("urban_intersection") == 1


def test_cases_have_files_for_simulators(place: Path) -> None:
    for case in scex.open_suite(place / "suite").cases:
        assert [file.suffix for file in sorted((case.folder / "openscenario").iterdir())].count(".xosc") == 2
        assert len(list((case.folder / "sumo").rglob("future.sumocfg"))) == 2


def test_commonroad_io_reads_the_cases(place: Path) -> None:
    reader = pytest.importorskip("commonroad.common.file_reader")
    for file in sorted((place / "suite" / "cases").rglob("commonroad/*.xml")):
        scenario, problems = reader.CommonRoadFileReader(str(file)).open()
        assert len(scenario.lanelet_network.lanelets) > 0
        assert len(problems.planning_problem_dict) == 1


def test_sumo_reads_the_cases(place: Path) -> None:
    libsumo = pytest.importorskip("libsumo")
    file = min((place / "suite" / "cases").rglob("future.sumocfg"))
    libsumo.start(["sumo", "-c", str(file), "--no-warnings", "--duration-log.disable"])
    try:
        libsumo.simulationStep()
        assert libsumo.vehicle.getIDCount() > 0
    finally:
        libsumo.close()


def test_a_function_is_judged_and_the_files_for_ci_are_written(place: Path) -> None:
    out = ("-o", place / "straight", "--junit", place / "straight.xml", "--futures", "24")
    done = run(place, "--under-test", "functions:Straight", *out)
    assert done.returncode == 0, done.stderr
    result = read(place, "straight")
    assert sum(result["verdicts"].values()) == len(result["cases"]) == 2
    assert result["verdicts"]["failed"] == 0
    rate = result["number"]["collisions_per_hour"]
    assert rate["low"] <= rate["value"] <= rate["high"]
    assert len(ET.parse(place / "straight.xml").getroot()[0]) == 2
    assert (place / "straight" / "summary.md").read_text().startswith("## functions:Straight on suite: ")
    assert "collisions an hour: " in done.stdout
    again = run(place, "--under-test", "functions:Straight", *out)
    assert {**read(place, "straight"), "seconds": 0, "command": 0} == {**result, "seconds": 0, "command": 0}
    assert again.returncode == 0
    against = ("--against", place / "straight" / "test.json", "--futures", "24")
    against += ("--cases", result["cases"][0]["name"])
    done = run(place, "--under-test", "likely_driver", *against, "-o", place / "likely")
    assert "against functions:Straight: " in done.stdout
    assert len(read(place, "likely")["cases"]) == 1


@pytest.mark.parametrize(
    ("function", "reason"), [("Nan", "not finite"), ("Short", "(1, 3)"), ("Crash", "no route")]
)
def test_a_bad_function_fails_its_case_with_the_reason(
    place: Path, function: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(place))
    case = scex.open_suite(place / "suite").cases[0]
    (spec,) = scex.parse_models(f"functions:{function}")
    found = attempt(run_case, task_of(case, spec, 8, limit_s=600.0))
    assert isinstance(found, Failure)
    assert reason in found.reason


def test_a_program_drives_a_case(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of the docs, in another process."""
    monkeypatch.chdir(Path(__file__).parents[2])
    case = scex.open_suite(place / "suite").cases[0]
    (spec,) = scex.parse_models(f"process:{sys.executable} docs/examples/process_driver.py")
    found = attempt(run_case, task_of(case, spec, 8, limit_s=600.0))
    assert not isinstance(found, Failure), found.reason
    assert found["futures"] == 8 and 0.0 <= found["probability"] <= 1.0


def test_a_function_without_end_fails_its_case_and_the_test(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sleeps, so that the worker has to end."""
    monkeypatch.syspath_prepend(str(place))
    name = scex.open_suite(place / "suite").cases[0].name
    options = {"cases": [name], "futures": 8, "out": place / "slow", "time_limit": 2.0}
    for _ in range(2):  # kept: nothing runs again
        done = scex.test_suite(place / "suite", "functions:Slow", **options)  # type: ignore[arg-type]
        (case,) = done.result["cases"]
        assert (case["verdict"], "did not return within 2 s" in case["reason"]) == ("failed", True)
        assert done.result["number"] is None


def test_the_workflow_of_the_docs_runs(place: Path) -> None:
    """All that is no service of the host: the test, its status and its summary."""
    yaml = pytest.importorskip("yaml")
    text = (Path(__file__).parents[2] / "docs" / "catalogue.md").read_text()
    workflow = yaml.safe_load(text.split("```yaml")[1].split("```")[0])
    lines = [step["run"] for step in workflow["jobs"]["driver"]["steps"] if "run" in step]
    assert lines[0] == "pip install scex-sumo"
    (place / "my_driver.py").write_text("from functions import Straight as Driver\n")
    name = scex.open_suite(place / "suite").cases[0].name
    words = [*shlex.split(lines[1])[1:], "--cases", name, "--futures", "8"]
    done = command(*words, cwd=place)
    result = read(place, "out/test")
    bad = result["verdicts"]["worse"] + result["verdicts"]["failed"]
    assert done.returncode == (1 if bad else 0)
    assert (place / "out" / "junit.xml").is_file()
    summary = place / "step.md"
    subprocess.run(lines[2], shell=True, cwd=place, env={"GITHUB_STEP_SUMMARY": str(summary)}, check=True)
    assert summary.read_text() == (place / "out" / "test" / "summary.md").read_text()


def test_wrong_input_is_one_line(place: Path, tmp_path: Path) -> None:
    def refused(folder: Path, **options: Any) -> str:
        with pytest.raises((ResultError, UsageError)) as error:
            scex.test_suite(
                folder, options.pop("under_test", "constant_velocity"), out=tmp_path / "out", **options
            )
        return str(error.value)

    suite = place / "suite"
    assert "no suite (suite.json is missing)" in refused(tmp_path)
    assert "--cases: no case 'x'" in refused(suite, cases=["x"])
    assert "SUMO drives it" in refused(suite, under_test="sumo:EIDM")
    assert "names 2 models" in refused(suite, under_test="standard_driver,constant_velocity")
    assert "--futures: got 2" in refused(suite, futures=2)
    for junit in ("/dev/full", tmp_path):
        assert "give the name of a file" in refused(suite, junit=junit)
    assert not (tmp_path / "out").exists()  # before any case runs
    copy = tmp_path / "copy"
    shutil.copytree(suite, copy)
    info = json.loads((copy / "suite.json").read_text())

    def with_case(**values: Any) -> dict[str, Any]:
        return {"cases": [info["cases"][0] | values, *info["cases"][1:]]}

    for changed, says in (
        ({"format": "scex-sumo suite 0"}, "format is \"scex-sumo suite 0\", needs 'scex-sumo suite 5'"),
        ({"cases": []}, "cases has 0 entries"),
        (with_case(weight=-100), "cases[0].weight is -100, needs more than 0"),
        (with_case(weight=float("nan")), "cases[0].weight is NaN, needs number"),
        (with_case(name="../../x"), 'cases[0].name is "../../x", needs the pattern'),
        (with_case(files={}), "has no cases[0].files.case.json"),
        ({"hours": "1"}, 'hours is "1", needs number'),
    ):
        (copy / "suite.json").write_text(json.dumps(info | changed))
        assert f"suite.json: {says}" in refused(copy)
    shutil.copyfile(suite / "suite.json", copy / "suite.json")
    seed = copy / "cases" / info["cases"][0]["name"] / "seed.csv"
    seed.write_text(seed.read_text()[:-9])
    assert "seed.csv: was changed since the suite was made" in refused(copy)
    seed.unlink()
    assert "seed.csv: is missing since the suite was made" in refused(copy)
