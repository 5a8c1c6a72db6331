"""Ten SUMO simulations for `benchmarks.what_if`: six made by SUMO's tools, and four of SUMO's games."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

from scex_sumo.base.sumo.programs import environment, run_program, sumo_home

GAMES: Final = ("cross", "square", "ramp", "grid6")
_CONFIG = """<configuration><input><net-file value="n.net.xml"/><route-files value="r.rou.xml"/></input>
<time><end value="300"/><step-length value="{step}"/></time>
<processing><time-to-teleport value="300"/>{more}</processing></configuration>"""
_STILL = '<pedestrian.striping.dawdling value="0"/>'
_GRID = ("--grid", "--grid.number", "4", "--grid.length", "150")
_GENERATED = {
    "grid": (0.5, 1.0, "", (*_GRID, "--turn-lanes", "1", "-j", "traffic_light")),
    "spider": (1.0, 0.5, "", ("--spider", "--spider.omit-center", "-j", "priority")),
    "actuated": (0.6, 1.0, "", (*_GRID, "-L", "2", "-j", "traffic_light", "--tls.default-type", "actuated")),
}
_LEFT = (*_GRID, "--lefthand", "-L", "2", "-j", "priority")
_MOTORWAY = (
    {"a": (0, 0), "b": (400, 0), "c": (650, 0), "d": (900, 0), "e": (1300, 0), "r": (200, -80)},
    {"ab": 2, "rb": 1, "bc": 3, "cd": 3, "de": 2},
    'speed="33.3"',
)
_FLOW = '<flow id="{0}" type="{1}" from="{2}" to="{3}" begin="0" end="300" period="{4}" departSpeed="avg"/>'
_TYPES = """<routes><vType id="car" sigma="0"/><vType id="truck" vClass="truck" sigma="0"/>
<vType id="bike" vClass="bicycle" sigma="0"/><vType id="bus" vClass="bus" sigma="0"/>"""


def ten_simulations(folder: Path) -> list[Path]:
    """Write six simulations below a folder; return them with those of the games."""
    for name, (period, step, more, words) in _GENERATED.items():
        _generated(folder / name, words, period, step, more)
    _generated(folder / "left", _LEFT, 1.0, 0.5, '<lateral-resolution value="0.8"/>', buses=True)
    nodes, lanes, more = _MOTORWAY
    flows = [("m", "car", "ab", "de", 2.2), ("t", "truck", "ab", "de", 9), ("o", "car", "rb", "de", 5)]
    _drawn(folder / "motorway", nodes, lanes, more, [_FLOW.format(*flow) for flow in flows], 1.0)
    _roundabout(folder / "roundabout")
    own = ("motorway", "roundabout", "left", *_GENERATED)
    games = sumo_home() / "tools" / "game"
    return [*(folder / name / "m.sumocfg" for name in own), *(games / f"{name}.sumocfg" for name in GAMES)]


def _generated(
    folder: Path, words: tuple[str, ...], period: float, step: float, more: str, *, buses: bool = False
) -> None:
    folder.mkdir(parents=True)
    run_program("netgenerate", *words, "--seed", "1", "-o", "n.net.xml", folder=folder, file_bytes=0)
    tool = str(sumo_home() / "tools" / "randomTrips.py")
    trips = [*("-n", "n.net.xml", "-o", "trips.xml", "-r", "r.rou.xml", "-e", "300"), "-p", str(period)]
    trips += ["--seed", "1", "--validate", "--min-distance", "200", "--fringe-factor", "5"]
    subprocess.run(
        [sys.executable, tool, *trips], cwd=folder, check=True, capture_output=True, env=environment()
    )
    if buses:
        tree = ElementTree.parse(folder / "r.rou.xml")
        tree.getroot().insert(0, ElementTree.Element("vType", id="bus", vClass="bus", sigma="0"))
        for vehicle in tree.getroot().findall("vehicle")[::8]:
            vehicle.set("type", "bus")
            stop = f"{vehicle[0].get('edges', '').split()[1]}_0"
            ElementTree.SubElement(vehicle, "stop", lane=stop, endPos="60", duration="8")
        tree.write(folder / "r.rou.xml")
    (folder / "m.sumocfg").write_text(_CONFIG.format(step=step, more=more))


def _drawn(
    folder: Path,
    nodes: dict[str, tuple[float, float]],
    lanes: dict[str, int],
    more: str,
    flows: list[str],
    step: float,
    options: tuple[str, ...] = (),
) -> None:
    """Write a simulation of nodes and straight edges, each named by its two nodes."""
    folder.mkdir(parents=True)
    places = "".join(f'<node id="{name}" x="{x:.2f}" y="{y:.2f}"/>' for name, (x, y) in nodes.items())
    edges = "".join(
        f'<edge id="{name}" from="{name[0]}" to="{name[1]}" numLanes="{count}" {more}/>'
        for name, count in lanes.items()
    )
    for name, text in (
        ("n.nod.xml", f"<nodes>{places}</nodes>"),
        ("n.edg.xml", f"<edges>{edges}</edges>"),
        ("r.rou.xml", f"{_TYPES}{''.join(flows)}</routes>"),
        ("m.sumocfg", _CONFIG.format(step=step, more=_STILL)),
    ):
        (folder / name).write_text(text)
    words = ("-n", "n.nod.xml", "-e", "n.edg.xml", "-o", "n.net.xml", *options)
    run_program("netconvert", *words, folder=folder, file_bytes=0)


def _roundabout(folder: Path) -> None:
    """A roundabout of 20 m with four arms, sidewalks and crossings."""
    ring, arms = "abcd", "wxyz"
    turns = [math.pi / 2 * k for k in range(4)]
    nodes = {n: (20 * math.cos(a), 20 * math.sin(a)) for n, a in zip(ring, turns, strict=True)}
    nodes |= {n: (120 * math.cos(a), 120 * math.sin(a)) for n, a in zip(arms, turns, strict=True)}
    lanes = {f"{ring[k]}{ring[(k + 1) % 4]}": 1 for k in range(4)}
    lanes |= {name: 1 for k in range(4) for name in (arms[k] + ring[k], ring[k] + arms[k])}
    flows = []
    for k in range(4):
        start, end = arms[k] + ring[k], ring[(k + 2) % 4] + arms[(k + 2) % 4]
        flows += [
            _FLOW.format(f"{one}{k}", one, start, end, period) for one, period in (("car", 9), ("bike", 25))
        ]
        walk = f'<walk from="{start}" to="{ring[k]}{arms[k]}" arrivalPos="20"/>'
        flows.append(
            f'<personFlow id="p{k}" begin="0" end="300" period="11" departPos="70">{walk}</personFlow>'
        )
    options = ("--sidewalks.guess", "--crossings.guess")
    _drawn(folder, nodes, lanes, 'speed="8.33"', flows, 0.5, options)
