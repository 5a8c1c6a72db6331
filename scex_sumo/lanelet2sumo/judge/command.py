"""Command ``scex-sumo convert``: a map as a SUMO net, and the judge of such nets."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from scex_sumo.base.errors import MapError
from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Origin
from scex_sumo.commands.shared import Answer

if TYPE_CHECKING:
    from scex_sumo.converters.net.sumo_net import SumoNet
    from scex_sumo.lanelet2sumo.judge.report import FidelityReport
    from scex_sumo.road import Road


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
    check: Annotated[
        Path | None, Option(metavar="NET", help="Judge this net of the map instead of converting.")
    ] = None,
    strict: Annotated[bool, Option("--strict", help="Fail if anything of the map is lost.")] = False,
) -> Answer:
    """Convert a map to a SUMO net and judge it, or judge a net."""
    from scex_sumo.base.blame import calling_twice
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.converters.maps import read_map
    from scex_sumo.lanelet2sumo.judge.report import check_net

    started = time.perf_counter()
    place = parse_origin(origin) if origin is not None else None
    with calling_twice():
        road = read_map(map_path, origin=place)
    if check is not None:
        report, losses, lines = _check(check, road), road.losses, []
    else:
        net = _convert(road, out, signals)
        seconds = time.perf_counter() - started
        report, losses = check_net(net.path, road, net.lanes), net.losses
        lanes = len(road.vehicle_lanes)
        lines = [
            f"{net.path}: {lanes} lanelets for vehicles, {len(road.lanes) - lanes} others, {seconds:.2f} s"
        ]
        lines += [f"look: sumo-gui -n {net.path} -a {net.extras}"] if net.extras is not None else []
    problems = report.problems()
    if check is not None:
        _print_figures(report)
    lines += [f"- {problem}" for problem in problems]
    lines += [f"{'warning: ' if loss.large else ''}lost: {loss}" for loss in losses]
    faithful = "faithful: nothing of the map is lost, all figures are within their bounds"
    print("\n".join(lines if problems or losses else [*lines, faithful]))
    judged, failure = check or net.path, None
    answer = {**report.figures, **({} if check is not None else {"seconds": round(seconds, 3)})}
    if problems:
        failure = f"{judged}: not faithful to the map: {len(problems)} figures are out of bounds"
    elif strict and losses:
        lost = ", ".join(f"{len(loss.elements)} {loss.kind} {loss.why}" for loss in losses)
        failure = f"{judged}: --strict, and the map lost {lost}; mend the map, or leave --strict out"
    if failure is not None:
        error = MapError(failure)
        error.answer = answer
        raise error
    return lambda: answer


def _convert(road: Road, out: Path | None, signals: Path | None) -> SumoNet:
    from scex_sumo.lanelet2sumo.convert import convert

    warn(road.notes)
    net = convert(road, out if out is not None else Path(f"{road.name}.net.xml"), signals=signals)
    warn(net.notes)
    return net


def _check(net_path: Path, road: Road) -> FidelityReport:
    from scex_sumo.converters.net.reading import read_lane_table
    from scex_sumo.converters.net.sumo_net import net_file
    from scex_sumo.lanelet2sumo.judge.report import check_net

    if not net_path.is_file():
        raise MapError(f"{net_path}: no such file; give the SUMO net to judge")
    table = net_file(net_path, ".lanes.csv")
    return check_net(net_path, road, read_lane_table(table) if table.is_file() else None)


def _print_figures(report: FidelityReport) -> None:
    from rich.table import Table

    from scex_sumo.commands.console import output_console

    table = Table(box=None, show_header=False, pad_edge=False)
    for row in report.rows():
        table.add_row(*row)
    output_console().print(table)
