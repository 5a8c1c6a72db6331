"""What the pages on drivers of one's own show runs as it stands there, with fewer futures."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command import ALONE, scex

DOCS = Path(__file__).resolve().parents[2] / "docs"


def blocks(page: str, kind: str) -> list[str]:
    """The fenced blocks of a kind."""
    return re.findall(rf"^```{kind}\n(.*?)^```$", (DOCS / page).read_text(), re.MULTILINE | re.DOTALL)


def write_files(page: str, where: Path) -> list[str]:
    """Write the blocks that begin with the name of a Python file; returns the names."""
    names = []
    for block in blocks(page, "python"):
        name = re.match(r"# (\w+\.py)\n", block)
        assert name is not None, f"{page}: a block does not say which file it is: {block[:60]}"
        (where / name[1]).write_text(block)
        names.append(name[1])
    return names


def commands(page: str) -> list[list[str]]:
    """The commands of the console blocks."""
    lines = [line[2:] for block in blocks(page, "console") for line in block.splitlines()]
    return [shlex.split(line) for line in lines]


def run(command: list[str], where: Path) -> str:
    """Run a command of the page with three futures and without pictures."""
    program, *arguments = command
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    if program == "scex-sumo":
        if "--futures" in arguments:
            at = arguments.index("--futures")
            del arguments[at : at + 2]
        few = ("--futures", 3, "--no-plots", *ALONE)
        done = scex("run", DOCS.parent / arguments[1], *arguments[2:], *few, cwd=where, env=environment)
    else:
        full = [sys.executable, *arguments]
        done = subprocess.run(
            full, cwd=where, capture_output=True, text=True, timeout=120, check=False, env=environment
        )
    assert done.returncode == 0, (command, done.stdout, done.stderr)
    return done.stdout


@pytest.fixture(scope="module")
def plug_in(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("plug_in")
    assert write_files("plug_in.md", where) == [
        "drivers.py", "export_torchscript.py", "export_onnx.py", "parked.py",
    ]  # fmt: skip
    return where


def test_the_predictor_of_the_page_drives_and_is_short(plug_in: Path) -> None:
    own, torchscript = commands("plug_in.md")[0], commands("plug_in.md")[2]
    assert own[:2] == ["scex-sumo", "run"] and "torchscript" in str(torchscript)
    code = [line for line in (plug_in / "drivers.py").read_text().splitlines()[1:] if line.strip()]
    assert len(code) <= 15
    printed = run(own, plug_in)
    assert "3 futures" in printed and "replaced" not in printed


def test_the_torchscript_file_of_the_page_drives(plug_in: Path) -> None:
    pytest.importorskip("torch")
    export, drive = commands("plug_in.md")[1:3]
    run(export, plug_in)
    assert "replaced" not in run(drive, plug_in)


def test_the_onnx_file_of_the_page_drives(plug_in: Path) -> None:
    for package in ("torch", "onnxruntime", "onnx", "onnxscript"):
        pytest.importorskip(package)
    run(["python", "export_torchscript.py"], plug_in)
    run(["python", "export_onnx.py"], plug_in)
    assert "replaced" not in run(commands("plug_in.md")[3], plug_in)


def test_the_class_of_the_page_drives(plug_in: Path) -> None:
    command = ["scex-sumo", "run", "scex_sumo/scenarios/data/roundabout.osm", "--models", "parked:Parked"]
    assert "replaced" not in run([*command, "-o", "out/parked"], plug_in)


def test_the_entry_of_the_page_drives_by_its_name(plug_in: Path) -> None:
    info = plug_in / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[scex_sumo.behaviors]\nacme = parked:Parked\n")
    listed = scex("models", cwd=plug_in, path=plug_in).stdout
    assert "acme " in listed and "Stays where it is." in listed


def test_the_driving_function_of_the_page_is_tested_and_read_back(tmp_path: Path) -> None:
    assert write_files("under_test.md", tmp_path) == ["acc.py", "compare.py"]
    (command,) = commands("under_test.md")
    printed = run(command, tmp_path)
    assert "under test, vehicle 8: acc:Acc: 3 futures" in printed and "replaced" not in printed
    read = run(["python", "compare.py"], tmp_path)
    assert read.startswith("{8: 'acc:Acc'}\n") and read.endswith("3 3\n")
