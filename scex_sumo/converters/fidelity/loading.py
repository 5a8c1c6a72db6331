"""Whether SUMO itself takes a net: load warnings, sumolib, and where moveToXY puts a car.

SUMO runs as a process of its own here, never as libsumo: that allows one simulation per process, and a judge
must not take the caller's.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.fidelity.matching import AHEAD_RAD, Matching, headings, sample
from scex_sumo.converters.fidelity.net import Net
from scex_sumo.errors import SimulationError
from scex_sumo.road import Road

PROBE_STEP_M = 2.0
PROBE_END_M = 0.3  # at its very ends a lanelet and its neighbours in line share their points
MATCH_THRESHOLD_M = 100.0  # SUMO's own; below 20 m it is quicker and at times takes a worse lane for a better
SAME_PLACE_M = 0.05  # branches of a fork lie on each other at first; either is the mapped lane there
LOAD_LIMIT_S = 60.0
RETRY_S = 0.05  # a small net takes SUMO a tenth of a second to load
RETRIES = int(LOAD_LIMIT_S / RETRY_S)


@dataclass(frozen=True, kw_only=True)
class LoadingFigures:
    """What SUMO says to the net.

    Attributes:
        sumo_warnings: lines that ``sumo`` writes to its error stream when it loads the net and does a step.
        sumolib_warnings: what sumolib says, internal lanes included.
        netconvert_errors: why netconvert, and with it netedit and every export, refuses the net.
        probes: centreline points of vehicle lanelets that moveToXY was asked for.
        probe_hits: those where it found a SUMO lane of the lanelet.
        lost_probes: (lanelet, misses) of the others, the most first.
    """

    sumo_warnings: tuple[str, ...]
    sumolib_warnings: tuple[str, ...]
    netconvert_errors: tuple[str, ...]
    probes: int
    probe_hits: int
    lost_probes: tuple[tuple[int, int], ...]


def sumo_binary(name: str = "sumo") -> str:
    """Path of a program of the eclipse-sumo wheel, whatever is on the user's PATH.

    Raises:
        SimulationError: the wheel is not installed.
    """
    import sumo

    program = Path(sumo.SUMO_HOME) / "bin" / (f"{name}.exe" if sys.platform == "win32" else name)
    if not program.is_file():
        raise SimulationError(f"{program}: SUMO's program {name} is missing; reinstall eclipse-sumo")
    return str(program)


def judge_loading(net: Net, road: Road, matching: Matching) -> LoadingFigures:
    """Load the net with sumo and sumolib, and drop a car on every lanelet's centreline."""
    said = _sumo_warnings(net.path)
    fatal = any(line.startswith("Error") for line in said)
    points, owners, directions = _probe_points(road)
    found = [""] * len(owners) if fatal else _ask_sumo(net, points, directions)
    misses: dict[int, int] = {}
    for point, direction, owner, lane in zip(points, directions, owners, found, strict=True):
        if not _mapped(net, matching, owner, lane, point, direction):
            misses[owner] = misses.get(owner, 0) + 1
    return LoadingFigures(
        sumo_warnings=said,
        sumolib_warnings=_sumolib_warnings(net.path),
        netconvert_errors=_netconvert_errors(net.path),
        probes=len(owners),
        probe_hits=len(owners) - sum(misses.values()),
        lost_probes=tuple(sorted(misses.items(), key=lambda entry: (-entry[1], entry[0]))),
    )


def _sumo_warnings(path: Path) -> tuple[str, ...]:
    command = [sumo_binary(), "-n", str(path), "--no-step-log", "--end", "1", "--xml-validation", "never"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LOAD_LIMIT_S, check=False)
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode != 0 and not lines:
        lines = [f"Error: sumo ended with status {done.returncode}"]
    return tuple(lines)


def _netconvert_errors(path: Path) -> tuple[str, ...]:
    command = [sumo_binary("netconvert"), "-s", str(path), "-o", os.devnull, "--offset.disable-normalization"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LOAD_LIMIT_S, check=False)
    if done.returncode == 0:
        return ()
    said = [line.strip() for line in done.stderr.splitlines() if line.startswith("Error")]
    return tuple(said or [f"Error: netconvert ended with status {done.returncode}"])


def _sumolib_warnings(path: Path) -> tuple[str, ...]:
    import sumolib

    heard = io.StringIO()
    with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stderr(heard):
        warnings.simplefilter("always")
        try:
            sumolib.net.readNet(str(path), withInternal=True)
        except (KeyError, ValueError, IndexError, AttributeError, TypeError, ElementTree.ParseError) as error:
            return (f"Error: sumolib cannot read it: {type(error).__name__}: {error}",)
    said = [
        str(warning.message) for warning in caught if not issubclass(warning.category, DeprecationWarning)
    ]
    return tuple(said + [line for line in heard.getvalue().splitlines() if line.strip()])


def _probe_points(road: Road) -> tuple[FloatArray, list[int], FloatArray]:
    """Points along every vehicle lanelet, the lanelet of each, and the heading there."""
    points, owners, directions = [np.empty((0, 2))], [], [np.empty(0)]
    for lane_id, lane in road.vehicle_lanes.items():
        line = shapely.LineString(lane.centreline)
        end = min(PROBE_END_M, 0.25 * line.length)
        at = np.linspace(end, line.length - end, max(int(line.length / PROBE_STEP_M), 1) + 1)
        points.append(shapely.get_coordinates(shapely.line_interpolate_point(line, at)))
        step = points[-1] - shapely.get_coordinates(shapely.line_interpolate_point(line, at - 0.5 * end))
        directions.append(np.arctan2(step[:, 1], step[:, 0]))
        owners += [lane_id] * len(at)
    return np.concatenate(points), owners, np.concatenate(directions)


def _ask_sumo(net: Net, points: FloatArray, directions: FloatArray) -> list[str]:
    """The lane on which SUMO puts a car at each point; an empty text where it knows none."""
    import sumolib
    import traci

    edge = next((lane.edge_id for lane in net.car_lanes.values() if not lane.internal), None)
    if edge is None:
        return [""] * len(points)
    command = [sumo_binary(), "-n", str(net.path), "--no-step-log", "--no-warnings", "--step-length", "0.1"]
    port = sumolib.miscutils.getFreeSocketPort()
    command += ["--collision.action", "none", "--remote-port", str(port)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # traci prints each attempt to reach its server
                connection = traci.connect(port, RETRIES, proc=server, waitBetweenRetries=RETRY_S)
            found = _drop_cars(connection, edge, points + net.offset, directions)
            connection.close()
        except traci.exceptions.TraCIException as error:
            raise SimulationError(f"{net.path}: sumo broke off with cars placed on it: {error}") from None
        finally:
            server.kill()  # no-op where it has ended
    return found


def _drop_cars(connection: Any, edge: str, points: FloatArray, directions: FloatArray) -> list[str]:
    """Lane of a car dropped at each point; one car at a time, or they would be in each other's way."""
    found = []
    connection.route.add("r", [edge])
    for number, (point, direction) in enumerate(zip(points, directions, strict=True)):
        name = str(number)
        angle = 90.0 - float(np.rad2deg(direction))  # SUMO: 0 = north, clockwise
        x, y = float(point[0]), float(point[1])
        connection.vehicle.add(name, "r")
        connection.vehicle.moveToXY(name, "", -1, x, y, angle, 2, MATCH_THRESHOLD_M)
        connection.simulationStep()
        alive = name in connection.vehicle.getIDList()
        found.append(connection.vehicle.getLaneID(name) if alive else "")
        if alive:
            connection.vehicle.remove(name)
    return found


def _mapped(
    net: Net, matching: Matching, owner: int, found: str, point: FloatArray, direction: float
) -> bool:
    """Whether the lane found stands for the lanelet, or runs through the very same place the same way."""
    own = [stretch.sumo_lane for stretch in matching.by_lanelet.get(owner, ())]
    if found in own:
        return True
    if (
        found not in net.lanes
        or _off(net, own, point) > SAME_PLACE_M
        or _off(net, [found], point) > SAME_PLACE_M
    ):
        return False
    lane = sample(net.lanes[found].shape, 0.2)
    off = np.hypot(*(lane - point).T)
    turn = headings(lane)[int(np.argmin(off))] - direction
    return bool(abs(np.angle(np.exp(1j * turn))) < AHEAD_RAD)


def _off(net: Net, lanes: list[str], point: FloatArray) -> float:
    """Distance of a point to the nearest of some SUMO lanes, m."""
    place = shapely.Point(point)
    return min((shapely.LineString(net.lanes[name].shape).distance(place) for name in lanes), default=np.inf)
