"""Command ``scex-sumo convert``: a map as a SUMO net, and how faithful it is."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from scex_sumo.base.errors import MapError
from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Origin
from scex_sumo.commands.shared import Answer

EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm -o out/roundabout.net.xml"


def convert_command(
    map_path: Annotated[Path, Argument(metavar="MAP.osm", help="Lanelet2 map (CommonRoad: .xml).")],
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="NET.net.xml", help="SUMO net to write.")
    ] = None,
    origin: Origin = None,
    signals: Annotated[
        Path | None, Option(metavar="CSV", help="Recorded signal phases (SPaT csv; its kml beside it).")
    ] = None,
    strict: Annotated[bool, Option("--strict", help="Fail if anything of the map is lost.")] = False,
) -> Answer:
    """Convert a map to a SUMO net and compare both."""
    from scex_sumo.base.blame import calling_twice
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.converters.maps import read_map
    from scex_sumo.lanelet2sumo.convert import convert
    from scex_sumo.lanelet2sumo.judge.report import check_net

    started = time.perf_counter()
    place = parse_origin(origin) if origin is not None else None
    with calling_twice():
        road = read_map(map_path, origin=place)
    warn(road.notes)
    net = convert(road, out if out is not None else Path(f"{road.name}.net.xml"), signals=signals)
    warn(net.notes)
    seconds = time.perf_counter() - started
    report, losses, lanes = check_net(net.path, road, net.lanes), net.losses, len(road.vehicle_lanes)
    print(f"{net.path}: {lanes} lanelets for vehicles, {len(road.lanes) - lanes} others, {seconds:.2f} s")
    print(f"look: sumo-gui -n {net.path} -a {net.extras}")
    problems = report.problems()
    lines = [f"- {problem}" for problem in problems]
    lines += [f"{'warning: ' if loss.large else ''}lost: {loss}" for loss in losses]
    faithful = "faithful: nothing of the map is lost, all figures are within their bounds"
    print("\n".join(lines or [faithful]))
    answer, failure = {**report.figures, "seconds": round(seconds, 3)}, None
    if problems:
        failure = f"{net.path}: not faithful to the map: {len(problems)} figures are out of bounds"
    elif strict and losses:
        lost = ", ".join(f"{len(loss.elements)} {loss.kind} {loss.why}" for loss in losses)
        failure = f"{net.path}: --strict, and the map lost {lost}; mend the map, or leave --strict out"
    if failure is not None:
        error = MapError(failure)
        error.answer = answer
        raise error
    return lambda: answer
