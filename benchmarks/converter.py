"""What converted maps are worth, map by map: the figures of the converter's tests, and seconds.

python benchmarks/converter.py MAP...
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
from tests.lanelet2sumo.judge.loading import check_net


def figures_of(map_path: Path, folder: Path) -> dict[str, str]:
    """Text of each figure of one map by name; lists of what is wrong are counted."""
    started = time.perf_counter()
    road = read_map(map_path)
    net = convert(road, folder / "m.net.xml")
    seconds = time.perf_counter() - started
    figures = check_net(net.path, road, net.lanes).figures | {"read and convert [s]": seconds}
    return {
        name: f"{len(value) if isinstance(value, tuple) else value:.4g}"
        for name, value in figures.items()
        if not isinstance(value, str)
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", nargs="+", type=Path, metavar="MAP")
    given = parser.parse_args()
    tables = {}
    for path in given.maps:
        with tempfile.TemporaryDirectory() as folder:
            try:
                tables[path.name.partition(".")[0]] = figures_of(path, Path(folder))
            except ScexError as error:
                parser.exit(1, f"{path}: {error}\n")
    print(f"{'':30}", *(f"{name[-20:]:>20}" for name in tables))
    for name in next(iter(tables.values())):
        print(f"{name:30}", *(f"{table[name]:>20}" for table in tables.values()))


if __name__ == "__main__":
    main()
