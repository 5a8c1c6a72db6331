"""Loading figures of a net: messages of sumo, sumolib and netconvert, and places by moveToXY.

SUMO runs in its own process, because libsumo allows one simulation per process.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections import Counter
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import shapely

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.sumo.programs import run_program
from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.extrapolation.processes.pool import in_other_process
from scex_sumo.geometry.polylines import samples, wrap
from scex_sumo.lanelet2sumo.judge.matching import Matching, match_lanelets
from scex_sumo.lanelet2sumo.judge.report import FidelityReport, Figure, measured
from scex_sumo.lanelet2sumo.reader import NetContent, read_net
from scex_sumo.road import Road
from tests.lanelet2sumo.judge import report as judge
from tests.lanelet2sumo.judge.by_geometry import AHEAD_RAD, lanes_by_geometry, sample_headings

PROBE_STEP_M = 2.0
PROBE_HIT_SHARE = 0.99
PROBE_END_M = 0.3  # at its very ends a lanelet and its neighbours in line share their points
MATCH_THRESHOLD_M = 100.0  # SUMO's own; below 20 m it finds worse lanes at times
SAME_PLACE_M = 0.05  # branches of a fork lie on each other at first; either is the mapped lane there


class Loading:
    """What sumo, sumolib and netconvert say about a net, and where SUMO puts cars on lanelets' centrelines.

    Attributes:
        probes: number of places; ``lost`` are those that SUMO puts onto other lanes, as (lanelet, places).
    """

    def __init__(self, matching: Matching) -> None:
        net, path = matching.net, matching.net.path.name
        run = partial(run_program, folder=net.path.parent, file_bytes=net.path.stat().st_size)
        self.sumo = run("sumo", "-n", path, "--no-step-log", "--end", "1", "--xml-validation", "never")
        refused = run("netconvert", "-s", path, "-o", os.devnull, "--offset.disable-normalization")
        self.netconvert = [line for line in refused if line.startswith("Error")]
        self.sumolib = _sumolib_warnings(net.path)
        points, owners, directions = _probe_points(matching.road)
        fatal = any(line.startswith("Error") for line in self.sumo)
        sumo_lanes = [""] * len(owners) if fatal else _ask_sumo(net, points, directions)
        misses = Counter(
            owner
            for point, direction, owner, lane in zip(points, directions, owners, sumo_lanes, strict=True)
            if not _mapped(matching, owner, lane, point, direction)
        )
        self.probes = len(owners)
        self.lost = sorted(misses.items(), key=lambda entry: (-entry[1], entry[0]))


LOADING = (
    Figure("sumo_warnings", lambda x: x.sumo, "sumo says"),
    Figure("sumolib_warnings", lambda x: x.sumolib, "sumolib says"),
    Figure("netconvert_errors", lambda x: x.netconvert, "netconvert refuses the net"),
    Figure("probes", lambda x: x.probes),
    Figure(
        "lost_probes",
        lambda x: x.lost,
        lambda f: f"moveToXY loses points of {f['probes']} (lanelet, points): {f['lost_probes']}",
        lambda f: sum(lost for _, lost in f["lost_probes"]) <= max(1, (1 - PROBE_HIT_SHARE) * f["probes"]),
    ),
)


def check_net(net_path: Path, road: Road, lanes: LaneTable | None = None) -> FidelityReport:
    """Judge a net, also by what SUMO's programs say of it."""
    report = judge.check_net(net_path, road, lanes)
    table = lanes_by_geometry(net_path, road) if lanes is None else lanes
    loading = Loading(match_lanelets(read_net(net_path).in_map(road), road, table))
    figures = {**report.figures, **measured(LOADING, loading)}
    return FidelityReport(figures=figures, table=(*report.table, *LOADING))


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
    return (*said, *filter(str.strip, heard.getvalue().splitlines()))


def _probe_points(road: Road) -> tuple[FloatArray, list[int], FloatArray]:
    parts: list[tuple[FloatArray, ...]] = [(np.empty((0, 2)), np.empty(0, np.int64), np.empty(0))]
    for lane_id, lane in road.vehicle_lanes.items():
        line = shapely.LineString(lane.centreline)
        end = min(PROBE_END_M, 0.25 * line.length)
        at = np.linspace(end, line.length - end, max(int(line.length / PROBE_STEP_M), 1) + 1)
        points, before = (
            shapely.get_coordinates(shapely.line_interpolate_point(line, s)) for s in (at, at - 0.5 * end)
        )
        parts.append((points, np.full(len(at), lane_id), np.arctan2(*(points - before).T[::-1])))
    points, owners, directions = map(np.concatenate, zip(*parts, strict=True))
    return points, owners.tolist(), directions


def _ask_sumo(net: NetContent, points: FloatArray, directions: FloatArray) -> list[str]:
    edge = next((lane.edge_id for lane in net.car_lanes.values() if not lane.internal), None)
    if edge is None:
        return [""] * len(points)
    asked = partial(_drop_cars, str(net.path.resolve()), edge, points + net.offset, directions)
    return in_other_process(asked, where="in the judge", died="SUMO died where cars were put")


def _drop_cars(path: str, edge: str, points: FloatArray, directions: FloatArray) -> list[str]:
    import libsumo

    options = "--no-step-log", "--no-warnings", "--step-length", "0.1", "--collision.action", "none"
    libsumo.start(["sumo", "-n", path, *options])
    lanes = []
    libsumo.route.add("r", [edge])
    for number, ((x, y), direction) in enumerate(zip(points.tolist(), directions, strict=True)):
        name = str(number)
        angle = 90.0 - float(np.rad2deg(direction))  # SUMO: 0 = north, clockwise
        libsumo.vehicle.add(name, "r")
        libsumo.vehicle.moveToXY(name, "", -1, x, y, angle, 2, MATCH_THRESHOLD_M)
        libsumo.simulationStep()
        alive = name in libsumo.vehicle.getIDList()
        lanes.append(libsumo.vehicle.getLaneID(name) if alive else "")
        if alive:
            libsumo.vehicle.remove(name)
    return lanes


def _mapped(matching: Matching, owner: int, sumo_lane: str, point: FloatArray, direction: float) -> bool:
    lanes, own, place = matching.net.lanes, matching.names(owner), shapely.Point(point)
    if sumo_lane in own or sumo_lane not in lanes:
        return sumo_lane in own
    if min((lanes[name].line.distance(place) for name in own), default=np.inf) > SAME_PLACE_M:
        return False
    off = lanes[sumo_lane].line.distance(place)
    if off > SAME_PLACE_M and not _covers(matching, sumo_lane, place, off):
        return False
    line = samples(lanes[sumo_lane].shape, 0.2)[1]
    heading = sample_headings(line)[int(np.argmin(np.hypot(*(line - point).T)))]
    return bool(abs(wrap(heading - direction)) < AHEAD_RAD)


def _covers(matching: Matching, sumo_lane: str, place: shapely.Point, off: float) -> bool:
    lanes = [matching.road.lanes[i] for i in matching.lanelets(sumo_lane)]
    distances = [(lane, shapely.LineString(lane.centreline).distance(place)) for lane in lanes]
    return any(m <= lane.width_m / 2 and abs(m - off) <= SAME_PLACE_M for lane, m in distances)
