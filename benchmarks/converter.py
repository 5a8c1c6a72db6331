"""What a converted map is worth: the figures of `convert` and the seconds to convert, map by map.

    python benchmarks/converter.py MAP.osm... [--vehicles 120]

Besides, how many of SUMO's own vehicles arrive on the net, and how many overlap.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from scex_sumo.base.errors import ScexError
from scex_sumo.converters.maps import read_map
from scex_sumo.lanelet2sumo.convert import convert

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.lanelet2sumo.judge.driving import drive_net
from tests.lanelet2sumo.judge.loading import check_net


def rows(map_path: Path, folder: Path, vehicles: int) -> list[tuple[str, str]]:
    """Name and text of each figure of one map."""
    started = time.perf_counter()
    road = read_map(map_path)
    net = convert(road, folder / f"{map_path.stem}.net.xml")
    seconds = time.perf_counter() - started
    report, driving = check_net(net.path, road, net.lanes), drive_net(net.path, vehicles=vehicles)
    table = [*report.rows(), *driving.rows(), ("read and convert [s]", f"{seconds:.2f}")]
    return [(name, text) for name, text in table if name not in ("net", "map", "lane_table")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", nargs="+", type=Path, metavar="MAP.osm")
    parser.add_argument("--vehicles", type=int, default=120, help="SUMO's own vehicles to drive")
    given = parser.parse_args()
    tables = {}
    with tempfile.TemporaryDirectory() as folder:
        for path in given.maps:
            try:
                tables[path.stem] = dict(rows(path, Path(folder), given.vehicles))
            except ScexError as error:
                parser.exit(1, f"{path}: {error}\n")
    print(f"{'':30}", *(f"{name:>20}" for name in tables))
    for name in next(iter(tables.values())):
        print(f"{name:30}", *(f"{table[name]:>20}" for table in tables.values()))


if __name__ == "__main__":
    main()
