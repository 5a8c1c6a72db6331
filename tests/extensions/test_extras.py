"""An extra of another package is one file: it has options, and its row is in every answer."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from scex_sumo import example_path
from tests.command import ALONE
from tests.extensions.package import install, scex

CODE = '''
from dataclasses import dataclass

import numpy as np
import scex_sumo as scex


@dataclass(frozen=True, kw_only=True)
class Speeding(scex.Extra):
    """Share of the vehicles that drive faster than a limit in the last step."""

    fast: float = scex.option("Speed above which a vehicle is fast, m/s.", 8.0, metavar="V")

    def after(self, work):
        speed = work.states.speed[:, -1]
        return [scex.Row(name="fast vehicles", value=100 * float(np.mean(speed > self.fast)), unit="%")]
'''
BROKEN = """
class Broken(scex.Extra):
    def __init__(self):
        raise ValueError("no camera")
"""
RUN = ("run", example_path("urban_intersection"), "--futures", 4, "--steps", 5, "--models", "rules")


def command(folder: Path, *options: object) -> list[object]:
    return [*RUN, "-o", folder / "out", *options]


def test_an_extra_of_another_package_has_an_option_and_a_row_everywhere(tmp_path: Path) -> None:
    install(tmp_path, group="scex_sumo.extras", name="speeding", target="stranger:Speeding", code=CODE)
    done = scex(tmp_path, *command(tmp_path, "--extra", "speeding:fast=5"))
    assert done.returncode == 0, done.stderr
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("fast vehicles [%]: "))
    info = json.loads((tmp_path / "out" / "run.json").read_text())
    human = json.loads((tmp_path / "out" / "reference" / "run.json").read_text())
    shown = [f"{one['rows'][0]['value']:.3g}" for one in (info, human)]
    assert info["rows"][0]["name"] == "fast vehicles" and all(value in line for value in shown)
    page = (tmp_path / "out" / "report.html").read_text()
    assert f"fast vehicles [%]: {shown[0]} stress test, {shown[1]} human-like" in page
    answer = scex(tmp_path, *command(tmp_path, "--extra", "speeding:fast=5", "--overwrite", "--json"))
    assert json.loads(answer.stdout)["rows"]["fast vehicles [%]"][0] == info["rows"][0]["value"]


def test_an_extra_by_its_import_path_needs_no_package(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(f"{CODE}\n{BROKEN}")
    options = (*ALONE, "--no-report")
    done = scex(tmp_path, *command(tmp_path, "--extra", "mine:Speeding:fast=50", *options), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "fast vehicles [%]" in done.stdout
    for given, said in (
        ("mine:Speeding:slow=1", "'slow=1' is no option of it; it has fast"),
        ("mine:Speeding:fast=x", "'x' is no number"),
        ("mine:np", "is no class derived from scex_sumo.Extra"),
        ("mine:Nothing", "has no Nothing"),
        ("mine:Broken", "extra mine:Broken raised ValueError: no camera (mine.py, line "),
    ):
        done = scex(tmp_path, *command(tmp_path, "--extra", given), cwd=tmp_path)
        assert done.returncode == 2 and said in done.stderr and "Traceback" not in done.stderr, done.stderr


@pytest.mark.parametrize(
    ("line", "instead", "says"),
    [
        ("speed = ", "{}['speed'];  speed = ", "after raised KeyError: 'speed' (stranger.py, line 15)"),
        ("return [scex", "return [1] or [scex", "after returned int, needs rows"),
    ],
)
def test_a_run_is_finished_without_the_rows_of_an_extra_that_fails(
    line: str, instead: str, says: str, tmp_path: Path
) -> None:
    (tmp_path / "stranger.py").write_text(CODE.replace(line, instead))
    given = ("--extra", "stranger:Speeding")
    done = scex(tmp_path, *command(tmp_path, *given, *ALONE, "--no-report"), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"warning: extra Speeding: {says}; its rows are left out" in done.stderr
    info = json.loads((tmp_path / "out" / "run.json").read_text())
    assert "fast vehicles" not in {row["name"] for row in info["rows"]}
