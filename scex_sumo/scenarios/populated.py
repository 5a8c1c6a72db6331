"""Seed scenes of a map that is populated without a recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import warn_notes
from scex_sumo.base.importing import Registry
from scex_sumo.base.progress import Progress
from scex_sumo.converters.maps import read_map
from scex_sumo.scene import SeedScene

POPULATIONS = Registry(group="scex_sumo.populations", kind="population")
"""Functions ``populate(road, vehicles=..., speed=..., seed=..., cache=..., progress=...)``: a seed scene."""

PASSERS_BY = Registry(group="scex_sumo.passers_by", kind="way to add people")
"""Functions ``add(scene, people, seed=...)``: the scene with so many people beside its vehicles."""


@checked
def synthetic_seed(
    map_path: str | Path,
    *,
    vehicles: int,
    like: str = "sumo",
    speed: float | None = None,
    people: int = 0,
    seed: int = 0,
    origin: tuple[float, float] | None = None,
    cache: bool = True,
    progress: Progress | bool | None = None,
) -> SeedScene:
    """Populate a map and return one moment.

    Args:
        map_path: a Lanelet2 map (``.osm``), or a CommonRoad scenario (``.xml``, ``.xml.gz``).
        like: ``sumo`` places vehicles by random demand and car-following, with history and future;
            ``recorded`` by the shipped scene model, without a future; or a name in `POPULATIONS`.
        speed: mean speed of a scene as recorded, m/s; None draws it for road and density.
        people: pedestrians and cyclists on footways and crossings, beside lanes and at their edges.
        seed: the same seed gives the same scene.
        origin: latitude and longitude of the map's coordinates; None looks beside the map, else takes its
            south-west corner.
        cache: keep road, net and scene in ``~/.cache/scex-sumo``.
        progress: True for a bar; or called with (done, total) while SUMO simulates.

    Raises:
        MapError: the map cannot be read.
        SimulationError: the map cannot hold so many vehicles, or SUMO would simulate too long.
        UsageError: ``like`` is unknown, or a speed is given to SUMO.

    Example:
        >>> scex.synthetic_seed(scex.example_path("roundabout"), vehicles=3).vehicles
        3
    """
    populate = POPULATIONS.load(like)
    road = read_map(map_path, origin=origin, own_corner=True, keep=cache)
    scene: SeedScene = populate(
        road, vehicles=vehicles, speed=speed, seed=seed, cache=cache, progress=progress
    )
    scene = replace(scene, road=road)
    if people:
        scene = PASSERS_BY.load("usual")(scene, people, seed=seed)
    warn_notes([*road.notes, *scene.notes])
    return scene
