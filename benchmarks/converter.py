"""What a converted map is worth: all fidelity figures and the seconds to convert, map by map.

    python benchmarks/converter.py MAP.osm... [--vehicles 120] [--opendrive] [--json]
    python benchmarks/converter.py MAP.osm --tiles 4    # a large map: 4 x 4 copies of this one

``--json`` prints every figure with the ids behind it; ``--opendrive`` judges, besides, what is left of the
geometry after netconvert has taken the net to OpenDRIVE and back. ``--tiles`` gives the processor time of a
conversion, the best of three, and what its dearest functions take of it.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.errors import ScexError
from scex_sumo.base.sumo.programs import program
from scex_sumo.converters.lanelet.reader import read_road
from scex_sumo.converters.net.convert import convert
from scex_sumo.lanelet2sumo.judge.report import check_net, drive_net
from scex_sumo.road import Lane, Regulation, Road


def measure(map_path: Path, folder: Path, *, vehicles: int, opendrive: bool) -> dict[str, Any]:
    """All figures of one map; the times are the best of three conversions."""
    reading, writing = [], []
    for _ in range(3):
        started = time.perf_counter()
        road = read_road(map_path)
        reading.append(time.perf_counter() - started)
        net = convert(road, folder / f"{map_path.stem}.net.xml")
        writing.append(time.perf_counter() - started - reading[-1])
    started = time.perf_counter()
    report = check_net(net.path, road, net.lanes)
    checking = time.perf_counter() - started
    if vehicles:
        report = replace(report, driving=drive_net(net.path, vehicles=vehicles))
    figures = report.to_dict()
    figures |= {"read_s": min(reading), "convert_s": min(writing), "check_s": checking}
    figures["problems"] = report.problems()
    if opendrive:
        figures["opendrive"] = round_trip(net.path, road, folder)
    return figures


def round_trip(net_path: Path, road: Road, folder: Path) -> dict[str, Any]:
    """Judge the net that comes back from OpenDRIVE, lanelets found by geometry; or say why none does."""
    exported, back = folder / f"{net_path.stem}.xodr", folder / f"{net_path.stem}.back.net.xml"
    keep = ["--offset.disable-normalization", "--no-turnarounds"]
    there = ["-s", str(net_path), "--opendrive-output", str(exported)]
    again = ["--opendrive-files", str(exported), "-o", str(back), "--opendrive.internal-shapes"]
    for options in (there, [*again, "--opendrive.curve-resolution", "0.5"]):
        command = [program("netconvert"), *keep, *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            errors = [line for line in done.stderr.splitlines() if line.startswith("Error")]
            return {"failed": errors[0] if errors else f"status {done.returncode}"}
    return check_net(back, road).to_dict()


def tiled(road: Road, tiles: int) -> Road:
    """A large map: copies of a road in a square, without links between them."""
    step = np.ptp(np.vstack([lane.left_bound for lane in road.lanes.values()]), axis=0) + 50.0
    ids = max(map(abs, road.lanes)) + 1
    lanes: dict[int, Lane] = {}
    rules: list[Regulation] = []
    for k in range(tiles**2):
        away, own = step * divmod(k, tiles), {i: ids * (2 * k + 1) + i for i in road.lanes}
        for i, lane in road.lanes.items():
            lines = {name: getattr(lane, name) + away for name in ("centreline", "left_bound", "right_bound")}
            sides = ("left", "right", "adjacent_left", "adjacent_right")
            beside = {name: own.get(getattr(lane, name)) for name in sides}
            links = ("successors", "predecessors", "conflicts")
            others = {name: tuple(own[j] for j in getattr(lane, name)) for name in links}
            lanes[own[i]] = replace(lane, lane_id=own[i], **lines, **beside, **others)
        for rule in road.regulations:
            named = ("lanes", "yielding", "priority")
            moved = {name: tuple(own[j] for j in getattr(rule, name)) for name in named}
            rules.append(replace(rule, element_id=rule.element_id + ids * k, **moved))
    return replace(road, lanes=lanes, regulations=tuple(rules), markings=(), areas=())


def large_map(path: Path, tiles: int, folder: Path) -> str:
    """Processor time of the conversion of a tiled map, and its dearest functions."""
    road = tiled(read_road(path), tiles)
    seconds = []
    for _ in range(3):
        started = time.process_time()
        convert(road, folder / "large.net.xml")
        seconds.append(time.process_time() - started)
    profile = cProfile.Profile()
    profile.runcall(convert, road, folder / "large.net.xml")
    stats = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    whole = max(cumulative for _, _, _, cumulative, _ in stats.values())
    shares = {
        f"{Path(file).stem}.{name}": cumulative / whole
        for (file, _, name), (_, _, _, cumulative, _) in stats.items()
        if "scex_sumo" in file and cumulative < 0.95 * whole
    }
    dearest = sorted(shares.items(), key=lambda item: -item[1])[:8]
    parts = ", ".join(f"{name} {share:.0%}" for name, share in dearest)
    return f"{path.stem} {tiles} x {tiles}: {len(road.lanes)} lanelets, {min(seconds):.2f} s; {parts}"


def rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """What the printed table shows of one map."""

    def part(done: int, whole: int) -> str:
        return f"{done}/{whole}"

    def kept(name: str) -> str:
        missing, invented = len(figures[f"missing_{name}"]), len(figures[f"invented_{name}"])
        return f"{part(figures[name] - missing, figures[name])} +{invented}"

    def right(name: str, wrong: str) -> str:
        return part(figures[name] - len(figures[wrong]), figures[name])

    table = [
        ("lanes", part(figures["lanes_present"], figures["lanelets"])),
        ("speed limits", part(figures["speeds_right"], figures["lanes_present"])),
        *(
            (f"deviation {k} [mm]", f"{1000 * figures[f'deviation_{k}_m']:.2f}")
            for k in ("p50", "p95", "max")
        ),
        (
            "width error mean / floor [m]",
            f"{figures['width_error_mean_m']:.2f} / {figures['width_error_floor_m']:.2f}",
        ),
        ("successors", kept("successors")),
        ("routes, all pairs", kept("routes")),
        ("routes, border to border", kept("border_routes")),
        ("lane changes permitted", kept("lane_changes")),
        ("conflicts that are foes", right("conflicts", "missing_foes")),
        ("right of way by rule", right("regulated_pairs", "wrong_priority")),
        ("right before left", right("from_the_right", "wrong_from_the_right")),
        ("traffic lights", right("signalled", "missing_signals")),
        ("mutual yields", str(len(figures["mutual_yields"]))),
        ("closed lanelets open to cars", str(len(figures["non_vehicle_as_cars"]))),
        (
            "complaints sumo / sumolib / netconvert",
            " / ".join(
                str(len(figures[k])) for k in ("sumo_warnings", "sumolib_warnings", "netconvert_errors")
            ),
        ),
        ("moveToXY hits", part(figures["probe_hits"], figures["probes"])),
        (
            "read / convert / check [s]",
            " / ".join(f"{figures[k]:.2f}" for k in ("read_s", "convert_s", "check_s")),
        ),
    ]
    if "driving" in figures:
        driving = figures["driving"]
        table += [
            ("arrived, routes", f"{part(driving['arrived'], driving['vehicles'])}, {driving['routes']}"),
            ("overlaps / teleports", f"{driving['overlapping_pairs']} / {driving['teleports']}"),
            ("warnings while driving", str(len(driving["warnings"]))),
        ]
    if "opendrive" in figures:
        back = figures["opendrive"]
        lanes, spread = "refused", "refused"
        if "failed" not in back:
            lanes = part(back["lanes_present"], back["lanelets"])
            spread = " / ".join(f"{1000 * back[f'deviation_{k}_m']:.0f}" for k in ("p50", "p95", "max"))
        table += [("OpenDRIVE: lanes", lanes), ("OpenDRIVE: deviation p50/p95/max [mm]", spread)]
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("maps", nargs="+", type=Path, metavar="MAP.osm")
    parser.add_argument("--vehicles", type=int, default=120, help="SUMO's own vehicles to drive; 0 for none")
    parser.add_argument("--opendrive", action="store_true", help="judge an OpenDRIVE round trip too")
    parser.add_argument("--json", action="store_true", help="every figure with its ids")
    parser.add_argument("--tiles", type=int, help="time only: N x N copies of each map as one")
    given = parser.parse_args(arguments)
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        if given.tiles:
            for path in given.maps:
                print(large_map(path, given.tiles, Path(folder)))
            return
        for path in given.maps:
            try:
                found[path.stem] = measure(
                    path, Path(folder), vehicles=given.vehicles, opendrive=given.opendrive
                )
            except ScexError as error:
                parser.exit(1, f"{path}: {error}\n")
    if given.json:
        print(json.dumps(found, indent=2))
        return
    tables = [rows(figures) for figures in found.values()]
    widths = [
        max(len(name), *(len(value) for _, value in table)) for name, table in zip(found, tables, strict=True)
    ]
    first = max(len(label) for label, _ in tables[0])
    print(" " * first, *(name.rjust(width) for name, width in zip(found, widths, strict=True)), sep="  ")
    for line in zip(*tables, strict=True):
        cells = (value.rjust(width) for (_, value), width in zip(line, widths, strict=True))
        print(line[0][0].ljust(first), *cells, sep="  ")
    for name, figures in found.items():
        problems = [*figures["problems"]]
        if "failed" in figures.get("opendrive", {}):
            problems.append(f"no OpenDRIVE: {figures['opendrive']['failed']}")
        for problem in problems:
            print(f"- {name}: {problem}")


if __name__ == "__main__":
    main()
