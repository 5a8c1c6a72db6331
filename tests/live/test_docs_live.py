"""The code of the page runs as it stands there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.formats.sumo.simulations import run

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
NODES = '<nodes><node id="A" x="0" y="0"/><node id="B" x="250" y="0"/><node id="C" x="400" y="0"/></nodes>'
EDGES = """<edges><edge id="fast" from="A" to="B" speed="20"/>
 <edge id="slow" from="B" to="C" speed="5"/></edges>"""
# Drivers follow closely and look once in 1.5 s: some collide where the road becomes slow.
ROUTES = """<routes><vType id="car" minGap="1" tau="0.3" sigma="0.8" decel="4" actionStepLength="1.5"/>
 <flow id="f" type="car" begin="0" end="12" probability="0.5" from="fast" to="slow"
  departSpeed="15"/></routes>"""
CONFIG = """<configuration><input><net-file value="g.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><step-length value="0.1"/></time></configuration>"""


def write_row(folder: Path) -> None:
    """Write a road that becomes slow, its traffic, and the code of the page."""
    files = {"r.nod.xml": NODES, "r.edg.xml": EDGES, "r.rou.xml": ROUTES, "mine.sumocfg": CONFIG}
    for name, text in files.items():
        (folder / name).write_text(text)
    run("netconvert", "-n", "r.nod.xml", "-e", "r.edg.xml", "-o", "g.net.xml", cwd=folder)
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        (folder / block.split()[1]).write_text(block)


@pytest.fixture(scope="module")
def row(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("row")
    write_row(folder)
    return folder


def test_a_warning_makes_a_vehicle_drive_otherwise(row: Path) -> None:
    code = "import warn; print(warn.run('mine.sumocfg', 12, {}, until=24))"
    hits = []
    for limit in (0.01, 1.0):
        command = [sys.executable, "-W", "error", "-c", code.format(limit)]
        done = subprocess.run(command, cwd=row, capture_output=True, text=True)
        assert not done.returncode, done.stderr
        hits.append(done.stdout.splitlines()[-1])
    assert hits[0] != hits[1]
