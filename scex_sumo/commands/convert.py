"""``scex-sumo convert``: a map as a SUMO net, and the judge of such nets."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from scex_sumo.commands.console import warn
from scex_sumo.commands.options import Origin
from scex_sumo.errors import MapError, ResultError, UsageError

if TYPE_CHECKING:
    from scex_sumo.converters.fidelity.report import FidelityReport
    from scex_sumo.road import Road


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
) -> None:
    """Convert a Lanelet2 or CommonRoad map to a SUMO net, or judge a net against its map."""
    if check is not None:
        source = check_map or map_path
        if source is None:
            raise UsageError("--check: needs the map too, with --map MAP.osm")
        _check(check, source, origin=origin, drive=drive, as_json=json_report)
    elif drive:
        raise UsageError("--drive: needs a net to drive on, with --check NET --map MAP")
    elif map_path is None:
        raise UsageError("convert: needs MAP.osm, or --check NET --map MAP.osm")
    else:
        _convert(map_path, out, origin=origin, signals=signals, as_json=json_report)


def _convert(
    map_path: Path, out: Path | None, *, origin: str | None, signals: Path | None, as_json: bool
) -> None:
    """Write the net, its lane table and its drawing; print the figures when asked for."""
    from scex_sumo.converters.net.convert import convert

    started = time.perf_counter()
    road = _read(map_path, origin)
    warn(road.notes)
    net_path = out if out is not None else Path(f"{road.name}.net.xml")
    try:
        net_path.parent.mkdir(parents=True, exist_ok=True)
        net = convert(road, net_path, signals=signals)
    except OSError as error:
        raise ResultError(f"{net_path}: cannot write: {error.strerror or error}") from None
    seconds = time.perf_counter() - started
    if as_json:
        from scex_sumo.converters.fidelity.report import check_net

        print(
            json.dumps(
                {**check_net(net.path, road, net.lanes).to_dict(), "seconds": round(seconds, 3)}, indent=2
            )
        )
        return
    lanes = len(road.vehicle_lanes)
    print(f"{net.path}: {lanes} lanelets for vehicles, {len(road.lanes) - lanes} others, {seconds:.2f} s")
    if net.extras is not None:
        print(f"look: sumo-gui -n {net.path} -a {net.extras}")


def _check(net_path: Path, map_path: Path, *, origin: str | None, drive: bool, as_json: bool) -> None:
    """Judge a net, ours or another converter's, against the map it should be; let SUMO's cars drive on it.

    Raises:
        MapError: what is wrong with it, where something is.
    """
    from scex_sumo.converters.fidelity.report import check_net, drive_net
    from scex_sumo.converters.net.convert import LaneTable, net_file

    if not net_path.is_file():
        raise MapError(f"{net_path}: no such file; give the SUMO net to judge")
    road = _read(map_path, origin)
    table_path = net_file(net_path, ".lanes.csv")
    table = LaneTable.read(table_path) if table_path.is_file() else None
    report = check_net(net_path, road, table)
    if drive:
        report = report.with_driving(drive_net(net_path))
    if as_json:
        print(json.dumps(report.to_dict(), indent=2))
    else:
        _print_report(report)
    problems = report.problems()
    if problems:
        raise MapError(f"{net_path}: {len(problems)} of its figures miss what a faithful net has")


def _read(map_path: Path, origin: str | None) -> Road:
    from scex_sumo.converters.lanelet.origin import parse_origin
    from scex_sumo.converters.maps import read_map

    return read_map(map_path, origin=parse_origin(origin) if origin is not None else None)


def _print_report(report: FidelityReport) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False)
    figures = report.to_dict()
    figures |= {f"driving_{name}": value for name, value in figures.pop("driving", {}).items()}
    for name, value in figures.items():
        if isinstance(value, (int, float, str)):
            table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    Console().print(table)
    for problem in report.problems():
        print(f"- {problem}")
