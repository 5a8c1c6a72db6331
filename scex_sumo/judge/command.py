"""Command ``scex-sumo convert``: a map as a SUMO net, and the judge of such nets."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from scex_sumo.base.errors import MapError, UsageError
from scex_sumo.base.files import writing
from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Origin

if TYPE_CHECKING:
    from scex_sumo.converters.net.convert import SumoNet
    from scex_sumo.judge.report import FidelityReport
    from scex_sumo.road import MapLoss, Road


EXAMPLE = "DR_DEU_Roundabout_OF.osm -o roundabout.net.xml"


def convert_command(
    map_path: Annotated[
        Path | None, Argument(metavar="MAP.osm", help="Lanelet2 map (CommonRoad: .xml).")
    ] = None,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="NET.net.xml", help="SUMO net to write.")
    ] = None,
    origin: Origin = None,
    signals: Annotated[
        Path | None, Option(metavar="CSV", help="Recorded signal phases (SPaT csv; its kml beside it).")
    ] = None,
    check: Annotated[
        Path | None, Option(metavar="NET", help="Judge this net against --map instead of converting.")
    ] = None,
    check_map: Annotated[
        Path | None, Option("--map", metavar="MAP.osm", help="Map that --check compares with.")
    ] = None,
    drive: Annotated[
        bool, Option("--drive", help="With --check: let 120 of SUMO's cars drive all routes, too.")
    ] = False,
    json_report: Annotated[bool, Option("--json-report", help="Print the fidelity figures as JSON.")] = False,
    strict: Annotated[bool, Option("--strict", help="Fail if anything of the map is lost.")] = False,
    country: Annotated[
        str | None,
        Option(metavar="CODE", help="Country whose speed limits hold where the map gives none, e.g. us."),
    ] = None,
) -> None:
    """Convert a map to a SUMO net and judge it, or judge a net."""
    source = check_map or map_path
    if check is not None and source is None:
        raise UsageError("--check: needs the map too, with --map MAP.osm")
    if drive and check is None:
        raise UsageError("--drive: needs a net to drive on, with --check NET --map MAP")
    if source is None:
        raise UsageError("convert: needs MAP.osm, or --check NET --map MAP.osm")
    from scex_sumo.judge.report import check_net

    started = time.perf_counter()
    road = _read(source, origin, country)
    if check is not None:
        report, losses = _check(check, road, drive=drive), road.losses
    else:
        net = _convert(road, out, signals)
        seconds = time.perf_counter() - started
        report, losses = check_net(net.path, road, net.lanes), net.losses
    if json_report:
        timing = {} if check is not None else {"seconds": round(seconds, 3)}
        print(json.dumps({**report.to_dict(), **timing}, indent=2))
    elif check is not None:
        _print_report(report)
    else:
        _print_net(net, road, seconds, report)
    _verdict(check or net.path, report, losses, strict=strict, quiet=json_report)


def _convert(road: Road, out: Path | None, signals: Path | None) -> SumoNet:
    from scex_sumo.converters.net.convert import convert

    warn(road.notes)
    net_path = out if out is not None else Path(f"{road.name}.net.xml")
    with writing(net_path):
        net_path.parent.mkdir(parents=True, exist_ok=True)
        net = convert(road, net_path, signals=signals)
    warn(net.notes)
    return net


def _check(net_path: Path, road: Road, *, drive: bool) -> FidelityReport:
    from scex_sumo.converters.net.allowed import allowed_copy
    from scex_sumo.converters.net.sumo_net import LaneTable, net_file
    from scex_sumo.judge.report import check_net, drive_net

    if not net_path.is_file():
        raise MapError(f"{net_path}: no such file; give the SUMO net to judge")
    table_path = net_file(net_path, ".lanes.csv")
    table = LaneTable.read(table_path) if table_path.is_file() else None
    with allowed_copy(net_path) as allowed:
        report = check_net(allowed, road, table)
        return replace(report, driving=drive_net(allowed)) if drive else report


def _verdict(
    net_path: Path, report: FidelityReport, losses: Sequence[MapLoss], *, strict: bool, quiet: bool
) -> None:
    for loss in losses if not quiet else ():
        print(f"{'warning: ' if loss.large else ''}lost: {loss}")
    problems = report.problems()
    if problems:
        raise MapError(f"{net_path}: not faithful to the map: {len(problems)} figures are out of bounds")
    if not losses and not quiet:
        print("faithful: nothing of the map is lost, all figures are within their bounds")
    if strict and losses:
        lost = ", ".join(f"{len(loss.elements)} {loss.kind} {loss.why}" for loss in losses)
        raise MapError(f"{net_path}: --strict, and the map lost {lost}; mend the map, or leave --strict out")


def _read(map_path: Path, origin: str | None, country: str | None) -> Road:
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.converters.lanelet.tags import parse_country
    from scex_sumo.converters.maps import read_map

    return read_map(
        map_path,
        origin=parse_origin(origin) if origin is not None else None,
        country=parse_country(country) if country is not None else None,
    )


def _print_net(net: SumoNet, road: Road, seconds: float, report: FidelityReport) -> None:
    lanes = len(road.vehicle_lanes)
    print(f"{net.path}: {lanes} lanelets for vehicles, {len(road.lanes) - lanes} others, {seconds:.2f} s")
    if net.extras is not None:
        print(f"look: sumo-gui -n {net.path} -a {net.extras}")
    for problem in report.problems():
        print(f"- {problem}")


def _print_report(report: FidelityReport) -> None:
    from rich.table import Table

    from scex_sumo.commands.console import output_console

    table = Table(box=None, show_header=False, pad_edge=False)
    figures = report.to_dict()
    figures |= {f"driving_{name}": value for name, value in figures.pop("driving", {}).items()}
    for name, value in figures.items():
        if isinstance(value, (int, float, str)):
            table.add_row(name, f"{round(value, 4):.4g}" if isinstance(value, float) else str(value))
    output_console().print(table)
    for problem in report.problems():
        print(f"- {problem}")
