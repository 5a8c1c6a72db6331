"""What converted maps are worth, map by map: the figures of `convert`, seconds, and whether traffic jams.

    python benchmarks/converter.py MAP... [--jams]

Teleports at 450, 900 and 1 800 vehicles an hour for 15 minutes in steps of 0.1 s: on all routes from border
to border, and on trips of SUMO's randomTrips.py, which begin and end on any road. ``--jams`` prints these.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.base.errors import ScexError
from scex_sumo.base.sumo.programs import environment, run_program, sumo_home
from scex_sumo.converters.maps import read_map
from scex_sumo.lanelet2sumo.convert import convert

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.lanelet2sumo.judge.driving import drive_net
from tests.lanelet2sumo.judge.loading import check_net

RATES_PER_H = (450, 900, 1800)
DEMAND_S, END_S = 900, 2000


def rows(map_path: Path, folder: Path, *, only_jams: bool) -> list[tuple[str, str]]:
    """Name and text of each figure of one map."""
    started = time.perf_counter()
    road = read_map(map_path)
    net = convert(road, folder / "m.net.xml")
    seconds = time.perf_counter() - started
    table = [] if only_jams else [*check_net(net.path, road, net.lanes).rows()]
    table += [("read and convert [s]", f"{seconds:.2f}")]
    table += [("teleports, border to border", " ".join(str(border(net.path, rate)) for rate in RATES_PER_H))]
    table += [("teleports, randomTrips.py", " ".join(str(anywhere(net.path, rate)) for rate in RATES_PER_H))]
    return [(name, text) for name, text in table if name not in ("net", "map", "lane_table")]


def border(net: Path, rate_per_h: int) -> int:
    """Teleports of vehicles that take all routes between the net's borders."""
    return int(
        drive_net(net, vehicles=rate_per_h * DEMAND_S // 3600, headway_s=3600 / rate_per_h)["teleports"]
    )


def anywhere(net: Path, rate_per_h: int, seed: int = 1) -> int:
    """Teleports of vehicles whose random trips begin and end on any road."""
    given = f"-n {net} -o trips.xml -r trips.rou.xml -e {DEMAND_S} -p {3600 / rate_per_h} --seed {seed}"
    tool = sumo_home() / "tools/randomTrips.py"
    words = [sys.executable, tool, *given.split(), "--validate", "--vehicle-class", "passenger"]
    subprocess.run(words, check=True, capture_output=True, env=environment(), cwd=net.parent)
    options = f"-n {net.name} -r trips.rou.xml --end {END_S} --step-length 0.1 --statistic-output said.xml"
    said = run_program("sumo", *options.split(), folder=net.parent, file_bytes=0, limit_s=300)
    assert not any(line.startswith("Error") for line in said), said
    return int(ElementTree.parse(net.parent / "said.xml").find("teleports").get("total"))  # type: ignore[union-attr,arg-type]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", nargs="+", type=Path, metavar="MAP")
    parser.add_argument("--jams", action="store_true", help="only seconds and teleports")
    given = parser.parse_args()
    tables = {}
    for path in given.maps:
        with tempfile.TemporaryDirectory() as folder:
            try:
                tables[path.name.partition(".")[0]] = dict(rows(path, Path(folder), only_jams=given.jams))
            except ScexError as error:
                parser.exit(1, f"{path}: {error}\n")
    print(f"{'':30}", *(f"{name[-20:]:>20}" for name in tables))
    for name in next(iter(tables.values())):
        print(f"{name:30}", *(f"{table[name]:>20}" for table in tables.values()))


if __name__ == "__main__":
    main()
