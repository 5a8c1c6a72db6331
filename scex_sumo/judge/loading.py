"""Loading figures of a net: messages of sumo, sumolib and netconvert, and places by moveToXY.

SUMO runs in its own process, because libsumo allows one simulation per process.
"""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import threading
import warnings
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import SimulationError
from scex_sumo.base.programs import checked_path, program
from scex_sumo.converters.net.reader import NetContent
from scex_sumo.judge.matching import (
    AHEAD_RAD,
    Matching,
    angle_between,
    sample_headings,
    sample_line,
)
from scex_sumo.road import Road

PROBE_STEP_M = 2.0
MAX_PROBES = 20_000  # on longer maps points are left out evenly
PROBE_END_M = 0.3  # at its very ends a lanelet and its neighbours in line share their points
MATCH_THRESHOLD_M = 100.0  # SUMO's own; below 20 m it finds worse lanes at times
SAME_PLACE_M = 0.05  # branches of a fork lie on each other at first; either is the mapped lane there
LOAD_LIMIT_S = 60.0
PROBES_LIMIT_S = 300.0  # SUMO may never end on a damaged net
RETRY_S = 0.05
RETRIES = int(LOAD_LIMIT_S / RETRY_S)


def judge_loading(matching: Matching) -> dict[str, Any]:
    """Load the net with sumo, sumolib and netconvert, and place a car on every lanelet's centreline."""
    net = matching.net
    said = _run(net.path, "sumo", "-n", "--no-step-log", "--end", "1", "--xml-validation", "never")
    fatal = any(line.startswith("Error") for line in said)
    refused = _run(net.path, "netconvert", "-s", "-o", os.devnull, "--offset.disable-normalization")
    points, owners, directions = _probe_points(matching.road)
    some = slice(None, None, len(owners) // MAX_PROBES + 1)  # a damaged map may have endless lanes
    points, owners, directions = points[some], owners[some], directions[some]
    found = [""] * len(owners) if fatal else _ask_sumo(net, points, directions)
    misses = Counter(
        owner
        for point, direction, owner, lane in zip(points, directions, owners, found, strict=True)
        if not _mapped(matching, owner, lane, point, direction)
    )
    return {
        "sumo_warnings": said,
        "sumolib_warnings": _sumolib_warnings(net.path),
        "netconvert_errors": tuple(line for line in refused if line.startswith("Error")),
        "probes": len(owners),
        "probe_hits": len(owners) - misses.total(),
        "lost_probes": tuple(sorted(misses.items(), key=lambda entry: (-entry[1], entry[0]))),
    }


def _run(net: Path, name: str, option: str, *options: str) -> tuple[str, ...]:
    command = [program(name), option, checked_path(net.name), *options]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=LOAD_LIMIT_S, check=False, cwd=net.parent
        )
    except subprocess.TimeoutExpired:
        return (f"Error: {name} was stopped after {LOAD_LIMIT_S:.0f} s",)
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode != 0 and not any(line.startswith("Error") for line in lines):
        lines.append(f"Error: {name} ended with status {done.returncode}")
    return tuple(lines)


def _sumolib_warnings(path: Path) -> tuple[str, ...]:
    import sumolib

    heard = io.StringIO()
    with warnings.catch_warnings(record=True) as caught, contextlib.redirect_stderr(heard):
        warnings.simplefilter("always")
        try:
            sumolib.net.readNet(str(path), withInternal=True)
        except (LookupError, ValueError, AttributeError, TypeError, ElementTree.ParseError) as error:
            return (f"Error: sumolib cannot read it: {type(error).__name__}: {error}",)
    said = [str(one.message) for one in caught if not issubclass(one.category, DeprecationWarning)]
    return tuple(said + [line for line in heard.getvalue().splitlines() if line.strip()])


def _probe_points(road: Road) -> tuple[FloatArray, list[int], FloatArray]:
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


def _ask_sumo(net: NetContent, points: FloatArray, directions: FloatArray) -> list[str]:
    import sumolib
    import traci

    edge = next((lane.edge_id for lane in net.car_lanes.values() if not lane.internal), None)
    if edge is None:
        return [""] * len(points)
    command = [program("sumo"), "-n", net.path.name, "--no-step-log", "--no-warnings", "--step-length", "0.1"]
    port = sumolib.miscutils.getFreeSocketPort()
    command += ["--collision.action", "none", "--remote-port", str(port)]
    nowhere, folder = subprocess.DEVNULL, net.path.parent
    with subprocess.Popen(command, stdout=nowhere, stderr=nowhere, cwd=folder) as server:
        stop = threading.Timer(PROBES_LIMIT_S, server.kill)
        stop.start()
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # traci prints each attempt to reach its server
                connection = traci.connect(port, RETRIES, proc=server, waitBetweenRetries=RETRY_S)
            found = _drop_cars(connection, edge, points + net.offset, directions)
            connection.close()
        except traci.exceptions.TraCIException as error:
            raise SimulationError(f"{net.path}: sumo broke off with cars placed on it: {error}") from None
        finally:
            stop.cancel()
            server.kill()  # no-op where it has ended
    return found


def _drop_cars(connection: Any, edge: str, points: FloatArray, directions: FloatArray) -> list[str]:
    found = []
    connection.route.add("r", [edge])
    for number, ((x, y), direction) in enumerate(zip(points.tolist(), directions, strict=True)):
        name = str(number)
        angle = 90.0 - float(np.rad2deg(direction))  # SUMO: 0 = north, clockwise
        connection.vehicle.add(name, "r")
        connection.vehicle.moveToXY(name, "", -1, x, y, angle, 2, MATCH_THRESHOLD_M)
        connection.simulationStep()
        alive = name in connection.vehicle.getIDList()
        found.append(connection.vehicle.getLaneID(name) if alive else "")
        if alive:
            connection.vehicle.remove(name)
    return found


def _mapped(matching: Matching, owner: int, found: str, point: FloatArray, direction: float) -> bool:
    lanes, own, place = matching.net.lanes, matching.names(owner), shapely.Point(point)
    if found in own or found not in lanes:
        return found in own
    if min((lanes[name].line.distance(place) for name in own), default=np.inf) > SAME_PLACE_M:
        return False
    off = lanes[found].line.distance(place)
    if off > SAME_PLACE_M and not _covers(matching, found, place, off):
        return False
    line = sample_line(lanes[found].shape, 0.2)
    heading = sample_headings(line)[int(np.argmin(np.hypot(*(line - point).T)))]
    return bool(abs(angle_between(direction, heading)) < AHEAD_RAD)


def _covers(matching: Matching, found: str, place: shapely.Point, off: float) -> bool:
    for lane in (matching.road.lanes[i] for i in matching.lanelets(found)):
        distance = float(shapely.LineString(lane.centreline).distance(place))
        if distance <= lane.width_m / 2 and abs(distance - off) <= SAME_PLACE_M:
            return True
    return False
