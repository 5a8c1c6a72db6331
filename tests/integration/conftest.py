"""A net with what is hard in nets: curves, two lanes, a junction with right of way, lane changes."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
import sumo

NODES = """<nodes>
 <node id="c" x="1000" y="1000" type="priority"/>
 <node id="e" x="1120" y="1020"/><node id="n" x="990" y="1130"/>
 <node id="w" x="870" y="980"/><node id="s" x="1010" y="870"/>
</nodes>"""
EDGES = """<edges>
 <edge id="e_in" from="e" to="c" numLanes="2" speed="13.9" priority="2"
  shape="1120,1020 1080,1020 1060,1012 1040,1004 1020,1000 1000,1000"/>
 <edge id="e_out" from="c" to="e" numLanes="2" speed="13.9" priority="2"
  shape="1000,1000 1020,1000 1040,1004 1060,1012 1080,1020 1120,1020"/>
 <edge id="w_in" from="w" to="c" numLanes="2" speed="13.9" priority="2"
  shape="870,980 900,980 930,990 960,1000 1000,1000"/>
 <edge id="w_out" from="c" to="w" numLanes="2" speed="13.9" priority="2"
  shape="1000,1000 960,1000 930,990 900,980 870,980"/>
 <edge id="n_in" from="n" to="c" numLanes="1" speed="8.3" priority="1"/>
 <edge id="n_out" from="c" to="n" numLanes="1" speed="8.3" priority="1"/>
 <edge id="s_in" from="s" to="c" numLanes="1" speed="8.3" priority="1"/>
 <edge id="s_out" from="c" to="s" numLanes="1" speed="8.3" priority="1"/>
</edges>"""


@pytest.fixture(scope="session")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A curved two-lane main road through (1000, 1000), lanes 3.2 m wide, crossed by a minor road."""
    return build(tmp_path_factory.mktemp("crossing"), NODES)


@pytest.fixture(scope="session")
def signals(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """The same with traffic lights."""
    return build(tmp_path_factory.mktemp("signals"), NODES.replace('"priority"', '"traffic_light"'))


def build(folder: Path, nodes: str) -> SimpleNamespace:
    (folder / "n.nod.xml").write_text(nodes)
    (folder / "n.edg.xml").write_text(EDGES)
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "-n", "n.nod.xml", "-e", "n.edg.xml"]
    options = ["-o", "n.net.xml", "--offset.disable-normalization", "--no-turnarounds", "--no-warnings"]
    subprocess.run(
        [*command, *options, "--junctions.corner-detail", "5"], cwd=folder, check=True, capture_output=True
    )
    return SimpleNamespace(path=folder / "n.net.xml", extras=None)
