"""The code of the page runs as it stands there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from tests.formats.sumo.simulations import run

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
NODES = '<nodes><node id="A" x="0" y="0"/><node id="B" x="250" y="0"/><node id="C" x="400" y="0"/></nodes>'
EDGES = """<edges><edge id="fast" from="A" to="B" speed="20"/>
 <edge id="slow" from="B" to="C" speed="5"/></edges>"""
ROUTES = """<routes><vType id="car" minGap="1" tau="0.3" sigma="0.8" decel="4" actionStepLength="1.5"/>
 <flow id="f" type="car" begin="0" end="12" probability="0.5" from="fast" to="slow"
  departSpeed="15"/></routes>"""
CONFIG = """<configuration><input><net-file value="g.net.xml"/><route-files value="r.rou.xml"/></input>
 <time><step-length value="0.1"/></time></configuration>"""


def test_the_loop_of_the_page_runs_and_prints_each_moment(tmp_path: Path) -> None:
    files = {"r.nod.xml": NODES, "r.edg.xml": EDGES, "r.rou.xml": ROUTES, "mine.sumocfg": CONFIG}
    (block,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    for name, text in {**files, "own_loop.py": block.replace("< 30", "< 8")}.items():
        (tmp_path / name).write_text(text)
    run("netconvert", "-n", "r.nod.xml", "-e", "r.edg.xml", "-o", "g.net.xml", cwd=tmp_path)
    command = [sys.executable, "-W", "error", "own_loop.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert not done.returncode, done.stderr
    assert "PairRisk(" in done.stdout
