"""Nets of somebody else: SUMO writes no file that they name, whatever command loads them."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from scex_sumo.base.errors import MapError, SimulationError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.converters.maps import read_map
from scex_sumo.converters.net.allowed import prune
from scex_sumo.converters.net.reading import allowed_content, open_net
from scex_sumo.lanelet2sumo.convert import convert
from scex_sumo.world.tiles import TileTemplate
from tests.command import ALONE, scex

LANE = 'lane="A0B0_0"'
KINDS = {
    "inductionLoop": f'<inductionLoop id="d" {LANE} pos="5" period="1" file="OUT"/>',
    "e1Detector": f'<e1Detector id="d" {LANE} pos="5" period="1" file="OUT"/>',
    "instantInductionLoop": f'<instantInductionLoop id="d" {LANE} pos="5" file="OUT"/>',
    "laneAreaDetector": f'<laneAreaDetector id="d" {LANE} pos="5" endPos="20" period="1" file="OUT"/>',
    "e2Detector": f'<e2Detector id="d" {LANE} pos="5" endPos="20" period="1" file="OUT"/>',
    "entryExitDetector": f'<entryExitDetector id="d" period="1" file="OUT"><detEntry {LANE} pos="5"/>'
    f'<detExit {LANE} pos="20"/></entryExitDetector>',
    "e3Detector": f'<e3Detector id="d" period="1" file="OUT"><detEntry {LANE} pos="5"/>'
    f'<detExit {LANE} pos="20"/></e3Detector>',
    "edgeData": '<edgeData id="d" file="OUT"/>',
    "laneData": '<laneData id="d" file="OUT"/>',
    "routeProbe": '<routeProbe id="d" edge="A0B0" period="1" file="OUT"/>',
    "vTypeProbe": '<vTypeProbe id="d" period="1" file="OUT"/>',
    "calibrator": '<calibrator id="d" edge="A0B0" pos="0" period="1" output="OUT">'
    '<flow begin="0" end="9" route="r" vehsPerHour="900"/></calibrator>',
    "timedEvent": '<timedEvent type="SaveTLSStates" source="A0" dest="OUT"/>',
    "include": '<include href="INCLUDED"/>',
    "vehicle": '<vType id="t"/><vehicle id="v" type="t" depart="0"><route edges="A0B0"/>'
    '<param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="OUT"/></vehicle>',
    "tlLogic": '<tlLogic id="B1" type="actuated" programID="mine" offset="0"><param key="file" value="OUT"/>'
    '<param key="freq" value="1"/>PHASE</tlLogic>',
}


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A grid with lights."""
    folder = tmp_path_factory.mktemp("grid")
    options = ["--grid", "--grid.number", "3", "--grid.length", "80", "--tls.set", "B1", "-o", "g.net.xml"]
    subprocess.run(
        [program("netgenerate"), *options], cwd=folder, check=True, capture_output=True, env=environment()
    )
    return (folder / "g.net.xml").read_text()


def hostile(folder: Path, grid: str, kind: str) -> tuple[Path, Path]:
    """The grid with one element more at its end, and the file that SUMO writes because of it."""
    out = folder / "written.xml"
    (folder / "included.xml").write_text(f'<additional><edgeData id="d" file="{out}"/></additional>')
    phases = re.findall(r"<phase [^>]*/>", grid)
    element = KINDS[kind].replace("OUT", str(out)).replace("INCLUDED", str(folder / "included.xml"))
    element = element.replace("PHASE", "".join(phases[:4]))
    net = folder / "mine.net.xml"
    net.write_text(grid.replace("</net>", f"{element}</net>"))
    return net, out


def simulate(net: Path) -> None:
    command = [program("sumo"), "-n", str(net), "--end", "3", "--xml-validation", "never"]
    subprocess.run(command, capture_output=True, env=environment(), check=False)


@pytest.mark.parametrize("kind", KINDS)
def test_sumo_writes_what_a_net_names_but_not_once_it_is_read_here(
    kind: str, grid: str, tmp_path: Path
) -> None:
    net, out = hostile(tmp_path, grid, kind)
    simulate(net)
    if kind not in ("calibrator", "timedEvent", "tlLogic", "vehicle"):  # these need traffic or time
        assert out.exists(), "the test has lost its meaning: SUMO no longer writes"
    out.unlink(missing_ok=True)
    road = read_map(net)
    assert not out.exists()
    assert any("only roads and lights are read, without 1" in note for note in road.notes)
    copy = convert(road, tmp_path / "copy.net.xml").path
    simulate(copy)
    assert not out.exists() and str(out) not in copy.read_text()
    with pytest.raises(SimulationError, match="cannot be copied to tiles"):
        TileTemplate(net)


def test_no_command_lets_a_foreign_net_write(grid: str, tmp_path: Path) -> None:
    net, out = hostile(tmp_path, grid, "edgeData")
    tracks = tmp_path / "t.fcd.xml"
    rows = "".join(
        f'<timestep time="{k / 10:.1f}"><vehicle id="a" x="{10 + k}" y="-1.6" angle="90" speed="10"'
        ' type="car"/></timestep>'
        for k in range(60)
    )
    tracks.write_text(f'<fcd-export><edgeData id="d" file="{out}"/>{rows}</fcd-export>')
    state = tmp_path / "s.xml"
    (tmp_path / "clean.net.xml").write_text(grid)
    (tmp_path / "r.rou.xml").write_text('<routes><trip id="a" depart="0" from="A0B0" to="B0A0"/></routes>')
    command = [program("sumo"), "-n", "clean.net.xml", "-r", "r.rou.xml", "--end", "4"]
    save = ["--save-state.times", "3", "--save-state.files", state.name, "--xml-validation", "never"]
    subprocess.run([*command, *save], cwd=tmp_path, capture_output=True, env=environment(), check=True)
    content = state.read_text().replace("<delay", f'<edgeData id="d" file="{out}"/><delay')
    state.write_text(content)
    small = ("--futures", 2, "--models", "constant_velocity", *ALONE)
    for words in (
        ("run", net, "--fcd", tracks, "--time", 2, *small, "-o", tmp_path / "fcd"),
        ("run", net, "--tracks", state, *small, "-o", tmp_path / "state"),
        ("run", net, "--synthetic", 2, *small, "-o", tmp_path / "synthetic"),
        ("inspect", net, "--tracks", tracks),
        ("convert", net, "-o", tmp_path / "c.net.xml"),
    ):
        done = scex(*words)
        assert "Traceback" not in done.stderr, (words, done.stderr)
        assert done.returncode == 0 or words[0] == "convert", (words, done.stderr)
        assert not out.exists(), words


def test_other_encodings_and_schemas_are_written_anew(grid: str, tmp_path: Path) -> None:
    net = tmp_path / "g.net.xml"
    plain = grid[grid.index("<net version") :]
    evil = plain.replace("http://sumo.dlr.de/xsd/net_file.xsd", "http://somewhere.example/x.xsd")
    for text, encoding in ((f'<?xml version="1.0" encoding="UTF-16"?>{plain}', "utf-16"), (evil, "utf-8")):
        net.write_bytes(text.encode(encoding))
        content, left_out = allowed_content(net)
        assert not left_out
        assert b"somewhere" not in content and content.startswith(b"<?xml")


def test_a_net_of_ours_that_somebody_changed_is_refused(grid: str, tmp_path: Path) -> None:
    net = tmp_path / "g.net.xml"
    net.write_text(grid)
    copy = convert(read_map(net), tmp_path / "copy.net.xml")
    open_net(copy.path)
    drawing = copy.extras
    assert drawing is not None
    drawing.write_text('<additional><include href="/x"/></additional>')
    with pytest.raises(MapError, match=r"copy\.add\.xml: changed since it was written: 1 <include> in it"):
        open_net(copy.path)


def test_parameters_of_lights_are_allowed_by_their_whole_names() -> None:
    params = "".join(f'<param key="{key}" value="x"/>' for key in ("max-gap:A0_1", "gap", "", "file"))
    root = ElementTree.fromstring(f'<net><tlLogic id="t">{params}</tlLogic></net>')
    assert len(prune(root)) == 3
    assert [one.get("key") for one in root.iter("param")] == ["max-gap:A0_1"]
