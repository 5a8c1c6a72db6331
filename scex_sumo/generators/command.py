"""``scex-sumo generate``: seed scenes on a map as recorded ones look, as cases in INTERACTION's format."""

from __future__ import annotations

import shlex
from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Option

from scex_sumo.base.errors import ResultError, UsageError
from scex_sumo.base.outputs import check_output, output, write_output
from scex_sumo.commands.console import progress_bar, warn
from scex_sumo.commands.options import MapPath, Origin, Overwrite, Seed

MAX_COUNT = 10_000
EXAMPLE = "scex_sumo/scenarios/data/roundabout.osm --count 2 -o out/scenes"


def generate_command(
    map_path: MapPath,
    vehicles: Annotated[
        int | None, Option(metavar="N", help="Vehicles of a scene; default: drawn as recorded.")
    ] = None,
    count: Annotated[int, Option(help="Number of scenes.")] = 20,
    scenes: Annotated[
        Path | None, Option(metavar="FILE", help="Scene model of 'train scenes'; default: the shipped one.")
    ] = None,
    origin: Origin = None,
    seed: Seed = 0,
    overwrite: Overwrite = False,
    out: Annotated[
        Path | None, Option("-o", "--out", metavar="DIR", help="Folder for map and cases.")
    ] = None,
) -> None:
    """Generate moments of traffic on a map, as recorded ones look."""
    from scex_sumo.converters.datasets.writer import write_tracks
    from scex_sumo.converters.lanelet.origin import META_DATA, parse_origin, recorded_origin
    from scex_sumo.converters.maps import LANELET2, read_map
    from scex_sumo.converters.naming import map_name
    from scex_sumo.converters.registries import map_format
    from scex_sumo.generators.generate import generated_scene
    from scex_sumo.generators.scene_model import SHIPPED, load_scenes
    from scex_sumo.roads.mirror import drawn_on

    if not 1 <= count <= MAX_COUNT:
        raise UsageError(f"--count: got {count:,}, needs 1 to {MAX_COUNT:,}")
    model = load_scenes(scenes or SHIPPED)
    road = read_map(map_path, origin=parse_origin(origin) if origin is not None else None, own_corner=True)
    warn(road.notes)
    folder = out if out is not None else Path("out") / f"{road.name}_generated"
    cases = folder / f"{map_name(map_path)}.csv"
    if folder.is_file():
        raise UsageError(f"-o {folder}: is a file; name a folder")
    target = folder / map_path.name
    if cases.exists() and not overwrite:
        raise ResultError(f"{cases}: exists; --overwrite replaces it")
    copied = not target.exists() or not target.samefile(map_path)
    local = map_format(map_path).read is not LANELET2.read or road.origin == (0.0, 0.0)
    origins = [] if local or recorded_origin(target) == road.origin else [folder / META_DATA]
    for file in (cases, *origins, *([target] if copied else [])):
        check_output(file, scenes)
    drawn, generate = [], partial(generated_scene, model=model, vehicles=vehicles, seed=seed)
    with progress_bar(f"generating {road.name}") as tick:
        for k in range(count):
            if tick is not None:
                tick(k, count)
            drawn.append(drawn_on(road, partial(generate, number=k)))
    warn(sorted({note for scene in drawn for note in scene.notes}))
    if copied:
        write_output(target, map_path.read_bytes())
    for file in origins:
        lat, lon = road.origin
        write_output(file, f"originLat,originLon\n{lat!r},{lon!r}\n".encode())
    with output(cases) as temporary:
        write_tracks(temporary, *drawn)
    print(f"cases:  {cases} ({count} scenes)")
    print(f"run:    scex-sumo run {shlex.quote(str(target))} --tracks {shlex.quote(str(cases))} --case 1")
