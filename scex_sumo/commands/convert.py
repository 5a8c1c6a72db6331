"""``scex-sumo convert``: a map as a SUMO net, and the judge of such nets."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING

from scex_sumo.commands.console import warn
from scex_sumo.converters.lanelet.origin import parse_origin
from scex_sumo.errors import MapError, ResultError
from scex_sumo.road import Road

if TYPE_CHECKING:
    from scex_sumo.converters.fidelity.report import FidelityReport


def convert_command(
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


def check_command(net_path: Path, map_path: Path, *, origin: str | None, as_json: bool) -> None:
    """Judge a net, ours or another converter's, against the map it should be.

    Raises:
        MapError: what is wrong with it, where something is.
    """
    from scex_sumo.converters.fidelity.report import check_net
    from scex_sumo.converters.net.convert import LaneTable, net_file

    if not net_path.is_file():
        raise MapError(f"{net_path}: no such file; give the SUMO net to judge")
    road = _read(map_path, origin)
    table_path = net_file(net_path, ".lanes.csv")
    table = LaneTable.read(table_path) if table_path.is_file() else None
    report = check_net(net_path, road, table)
    if as_json:
        print(json.dumps(report.to_dict(), indent=2))
    else:
        _print_report(report)
    problems = report.problems()
    if problems:
        raise MapError(f"{net_path}: {len(problems)} of its figures miss what a faithful net has")


def _read(map_path: Path, origin: str | None) -> Road:
    from scex_sumo.converters.maps import read_map

    return read_map(map_path, origin=parse_origin(origin) if origin is not None else None)


def _print_report(report: FidelityReport) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False)
    for name, value in report.to_dict().items():
        if isinstance(value, (int, float, str)):
            table.add_row(name, f"{value:.4g}" if isinstance(value, float) else str(value))
    Console().print(table)
    for problem in report.problems():
        print(f"- {problem}")
