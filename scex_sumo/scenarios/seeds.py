"""Seed scenes together with their map: recorded ones read, synthetic ones populated by SUMO."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

from scex_sumo.errors import TrackError
from scex_sumo.files import TemporaryFolder
from scex_sumo.kept import kept_object
from scex_sumo.scene import SeedScene, States
from scex_sumo.version import version_of


def read_seed(
    map_path: str | Path,
    *,
    tracks: str | Path | None = None,
    case: str | None = None,
    time: float | None = None,
    origin: tuple[float, float] | None = None,
    align: bool = True,
    cache: bool = True,
) -> SeedScene:
    """Read one moment of a recording, with its map.

    Args:
        map_path: a Lanelet2 map (``.osm``), or a CommonRoad scenario (``.xml``, ``.xml.gz``).
        tracks: a track file in INTERACTION format, a CommonRoad scenario, or a folder with the chunks of one
            CommonRoad recording; None looks where the dataset's
            folder layout has it, and takes a CommonRoad map's own vehicles.
        case: the case of a file with ``case_id``; None takes the busiest one.
        time: the moment in seconds of the recording; None takes frame 10 of a case, and of a recording the
            moment with most moving vehicles recorded from 1 s before to 3 s after.
        origin: latitude and longitude of the map's coordinates; None looks beside the tracks.
        align: whether tracks that lie beside the map's lanes are moved onto them, see `align_tracks`; False
            leaves them where they were recorded.
        cache: keep the road in ``~/.cache/scex-sumo`` for the next run on the same map.

    Returns:
        The seed scene, its ``road`` set.

    Raises:
        MapError: the map cannot be read.
        TrackError: the tracks cannot be read, or hold no such moment.
    """
    from scex_sumo.converters.datasets.seed import recorded_scene
    from scex_sumo.converters.maps import read_map
    from scex_sumo.converters.tracks.find import find_tracks

    map_path = Path(map_path)
    try:
        track_path = Path(tracks) if tracks is not None else find_tracks(map_path)
    except TrackError:
        read_map(map_path)  # a file that is no map is the likelier reason, and says so
        raise
    road = read_map(map_path, origin=origin, tracks=track_path, own_corner=False, keep=cache)
    scene = recorded_scene(map_path, tracks=track_path, case=case, time_s=time, road=road, align=align)
    return dataclasses.replace(scene, road=road)


def synthetic_seed(
    map_path: str | Path,
    *,
    vehicles: int,
    seed: int = 0,
    origin: tuple[float, float] | None = None,
    cache: bool = True,
) -> SeedScene:
    """Populate a map by SUMO's own demand and car-following, and take one moment of it.

    Args:
        map_path: a Lanelet2 map (``.osm``), or a CommonRoad scenario (``.xml``, ``.xml.gz``).
        vehicles: how many vehicles the seed scene has.
        seed: the same seed gives the same scene.
        origin: latitude and longitude of the map's coordinates; None looks beside the map, and takes its
            south-west corner where nothing is said: no tracks need to match.
        cache: keep road, net and scene in ``~/.cache/scex-sumo`` for the next run on the same map.

    Returns:
        The seed scene with a history and a future from the same SUMO run, its ``road`` set.

    Raises:
        MapError: the map cannot be read.
        SimulationError: the map cannot hold so many vehicles.
    """
    from scex_sumo.converters.maps import read_map
    from scex_sumo.converters.net.kept import converted
    from scex_sumo.scenarios.traffic.synthetic import synthetic_scene

    map_path = Path(map_path)
    road = read_map(map_path, origin=origin, own_corner=True, keep=cache)
    name = f"{road.name}_synthetic{vehicles}_s{seed}"

    def populated() -> SeedScene:
        with TemporaryFolder() as folder:
            net = converted(road, Path(folder) / f"{road.name}.net.xml", keep=cache)
            return synthetic_scene(road, net, vehicles=vehicles, seed=seed, name=name)

    if cache:
        made_of = pickle.dumps((version_of("eclipse-sumo"), vehicles, seed, road))
        scene = kept_object("populated", made_of, populated, (SeedScene, States))
    else:
        scene = populated()
    return dataclasses.replace(scene, road=road)
