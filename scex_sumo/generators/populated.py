"""Seed scenes of a map that is populated without a recording."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import UsageError, warn_notes
from scex_sumo.base.progress import Progress
from scex_sumo.converters.maps import read_map
from scex_sumo.generators.generate import generated_scene
from scex_sumo.generators.scene_model import load_scenes
from scex_sumo.generators.synthetic import sumo_population
from scex_sumo.roads.mirror import drawn_on
from scex_sumo.scene import SeedScene

SUMO, RECORDED = "sumo", "recorded"


@checked
def synthetic_seed(
    map_path: str | Path,
    *,
    vehicles: int,
    like: str = "sumo",
    seed: int = 0,
    origin: tuple[float, float] | None = None,
    cache: bool = True,
    progress: Progress | bool | None = None,
) -> SeedScene:
    """Populate a map and return one moment.

    Args:
        map_path: a Lanelet2 map (``.osm``), or a CommonRoad scenario (``.xml``, ``.xml.gz``).
        like: ``sumo`` places vehicles by random demand and car-following, with history and future;
            ``recorded`` by the shipped scene model, without a future.
        seed: the same seed gives the same scene.
        origin: latitude and longitude of the map's coordinates; None looks beside the map, else takes its
            south-west corner.
        cache: keep road, net and scene in ``~/.cache/scex-sumo``.
        progress: True for a bar; or called with (done, total) while SUMO simulates.

    Raises:
        MapError: the map cannot be read.
        SimulationError: the map cannot hold so many vehicles, or SUMO would simulate too long.
        UsageError: ``like`` is unknown.

    Example:
        >>> scex.synthetic_seed(scex.example_path("roundabout"), vehicles=3).vehicles
        3
    """
    if like not in (SUMO, RECORDED):
        raise UsageError(f"--as: unknown population {like!r}; known: {SUMO}, {RECORDED}")
    road = read_map(map_path, origin=origin, own_corner=True, keep=cache)
    draw = partial(generated_scene, model=load_scenes(), vehicles=vehicles, seed=seed)
    if like == SUMO:
        draw = partial(sumo_population, vehicles=vehicles, seed=seed, cache=cache, progress=progress)
    # SUMO's own nets say on which side they are driven.
    scene = replace(drawn_on(road, draw) if road.net is None else draw(road), road=road)
    warn_notes([*road.notes, *scene.notes])
    return scene
