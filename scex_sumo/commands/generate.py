"""``scex-sumo generate``: seed scenes on a map as recorded ones look, as cases in INTERACTION's format."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Option

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.files import write_atomic
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.options import MapPath, Origin, Overwrite, Seed

MAX_COUNT = 10_000
EXAMPLE = "k733.osm --vehicles 12 --count 20 -o out/k733_scenes"


def generate_command(
    map_path: MapPath,
    vehicles: Annotated[
        int | None, Option(metavar="N", help="Vehicles of a scene; default: drawn as recorded.")
    ] = None,
    count: Annotated[int, Option(help="Number of scenes.")] = 20,
    scenes: Annotated[
        Path | None, Option(metavar="FILE", help="Scene model of 'train scenes'; default: the shipped one.")
    ] = None,
    region: Annotated[
        str | None,
        Option(metavar="X,Y,R", help="Vehicles in this circle only, m; default: on the whole map."),
    ] = None,
    origin: Origin = None,
    seed: Seed = 0,
    overwrite: Overwrite = False,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="DIR", help="Folder for map and cases.")
    ] = None,
) -> None:
    """Generate seed scenes on a map as recorded ones look: cases that every command takes."""
    from scex_sumo.converters.datasets.writer import write_tracks
    from scex_sumo.converters.lanelet.origin import META_DATA, parse_origin
    from scex_sumo.converters.maps import LANELET2, read_map
    from scex_sumo.converters.naming import map_name
    from scex_sumo.converters.registries import map_format
    from scex_sumo.results.region import parse_region
    from scex_sumo.scenarios.generate import generated_scene
    from scex_sumo.scenarios.scene_context import lane_cells
    from scex_sumo.scenarios.scene_model import SHIPPED, load_scenes

    if not 1 <= count <= MAX_COUNT:
        raise UsageError(f"--count: got {count:,}, needs 1 to {MAX_COUNT:,}")
    model = load_scenes(scenes or SHIPPED)
    road = read_map(map_path, origin=parse_origin(origin) if origin is not None else None, own_corner=True)
    warn(road.notes)
    folder = out if out is not None else Path("out") / f"{road.name}_generated"
    cases = folder / f"{map_name(map_path)}.csv"
    if folder.is_file():
        raise UsageError(f"-o {folder}: is a file; name a folder")
    if cases.exists() and not overwrite:
        raise ResultError(f"{cases}: exists; --overwrite replaces it")
    made, cells, circle = [], None, parse_region(region, None).circle
    if circle is not None and road.vehicle_lanes:
        x, y, _ = lane_cells(road).cell_pose
        cells = np.hypot(x - circle[0], y - circle[1]) <= circle[2]
    with progress_bar(f"generating {road.name}") as tick:
        for k in range(count):
            if tick is not None:
                tick(k, count)
            made.append(generated_scene(road, model, vehicles=vehicles, seed=seed, number=k, cells=cells))
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / map_path.name
    if target.resolve() != map_path.resolve():
        shutil.copyfile(map_path, target)
    if map_format(map_path).read is LANELET2.read and road.origin != (0.0, 0.0):
        lat, lon = road.origin
        write_atomic(folder / META_DATA, f"originLat,originLon\n{lat!r},{lon!r}\n".encode())
    write_tracks(cases, *made)
    print(f"cases:  {cases} ({count} scenes)")
    print(f"run:    scex-sumo run {shlex.quote(str(target))} --tracks {shlex.quote(str(cases))} --case 1")
