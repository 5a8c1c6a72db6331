from __future__ import annotations

import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from scex_sumo.base.errors import TrackError
from scex_sumo.base.sumo.programs import environment, program
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.sumo.fcd import read_fcd
from scex_sumo.formats.sumo.scenario import SAVED

ROUTES = """<routes>
 <vType id="car" vClass="passenger"/><vType id="truck" vClass="truck"/>
 <flow id="f" type="car" begin="0" end="60" period="3" from="A0A1" to="C1C2" departLane="best"/>
 <flow id="t" type="truck" begin="0" end="60" period="7" from="C0B0" to="A1A2"/>
</routes>"""


def read_state(path: Path, net: Path | None) -> tuple[TrackTable, tuple[str, ...]]:
    return SAVED.read([path], net=net)


@pytest.fixture(scope="module")
def simulation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Traffic on a grid: its state at 25 s, and its floating car data."""
    folder = tmp_path_factory.mktemp("simulation")
    (folder / "r.rou.xml").write_text(ROUTES)
    grid = ["--grid", "--grid.number", "3", "--grid.length", "80", "-L", "2", "-o", "g.net.xml"]
    files = ["-n", "g.net.xml", "-r", "r.rou.xml", "--fcd-output", "g.fcd.xml", "--save-state.files", "s.xml"]
    times = ["--save-state.times", "25", "--end", "26", "--step-length", "0.5", "--lateral-resolution", "0.8"]
    for name, options in (("netgenerate", grid), ("sumo", [*files, *times, "--precision", "6"])):
        command = [program(name), *options]
        subprocess.run(command, cwd=folder, check=True, capture_output=True, env=environment())
    return folder


def test_vehicles_are_where_floating_car_data_had_them_before_the_state_was_saved(simulation: Path) -> None:
    state, findings = read_state(simulation / "s.xml", simulation / "g.net.xml")
    data, _ = read_fcd(simulation / "g.fcd.xml")
    assert len(findings) == 1  # numbers for names; SUMO knows the sizes of its types
    (before,) = {round(float(t)) for t in data.vehicles.timestamp_ms if abs(t - 24_500.0) < 1.0}
    then = np.abs(data.vehicles.timestamp_ms - before) < 1.0
    assert len(state.vehicles) == then.sum() > 5  # state's time is when the step begins, that of data its end
    mine = np.lexsort((state.vehicles.y, state.vehicles.x))
    other = np.flatnonzero(then)[np.lexsort((data.vehicles.y[then], data.vehicles.x[then]))]
    apart = np.hypot(*(getattr(state.vehicles, x)[mine] - getattr(data.vehicles, x)[other] for x in "xy"))
    changing = apart > 0.03  # states are written in centimetres; lane changes of the data are drawn over 3 s
    assert changing.sum() <= 2 and apart.max() < 1.6
    np.testing.assert_allclose(state.vehicles.speed[mine], data.vehicles.speed[other], atol=0.01)


def test_a_state_of_another_net_or_without_one_is_refused(simulation: Path, tmp_path: Path) -> None:
    with pytest.raises(TrackError, match="give that as the map"):
        read_state(simulation / "s.xml", None)
    net = tmp_path / "other.net.xml"
    net.write_text((simulation / "g.net.xml").read_text().replace('<lane id="A0A1', '<lane id="else'))
    with pytest.raises(TrackError, match="give the net that was simulated"):
        read_state(simulation / "s.xml", net)
    empty = tmp_path / "empty.xml"
    state = ElementTree.parse(simulation / "s.xml")
    for element in [e for e in state.getroot() if e.tag in ("vehicle", "lane")]:
        state.getroot().remove(element)
    state.write(empty)
    with pytest.raises(TrackError, match="no vehicle on the road"):
        read_state(empty, simulation / "g.net.xml")
    empty.write_text("<snapshot")
    with pytest.raises(TrackError, match="give the net that was simulated"):
        read_state(empty, simulation / "g.net.xml")
    empty.write_text('<?xml version="1.0" encoding="UTF-1"?><snapshot/>')
    with pytest.raises(TrackError, match="give the net that was simulated"):
        read_state(empty, simulation / "g.net.xml")
