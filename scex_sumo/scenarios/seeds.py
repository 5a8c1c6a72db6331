"""Seed scenes with their map: recorded, or populated by SUMO."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

from scex_sumo.base.cache import cached_object
from scex_sumo.base.errors import TrackError, UsageError, warn_notes
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.progress import Progress, progress_of
from scex_sumo.base.version import version_of
from scex_sumo.scene import Obstacles, SeedScene, States


def read_seed(
    map_path: str | Path,
    *,
    tracks: str | Path | None = None,
    case: str | None = None,
    time: float | None = None,
    origin: tuple[float, float] | None = None,
    align: bool = True,
    force: bool = False,
    cache: bool = True,
    progress: Progress | bool | None = None,
) -> SeedScene:
    """Read one moment of a recording, with its map; notes on both are `ScexWarning`.

    Args:
        map_path: a map, or a folder with one recording and its map.
        tracks: a track file in INTERACTION format, a CommonRoad scenario, or a folder with the chunks of a
            CommonRoad recording; None: the dataset's folder layout, or a CommonRoad map's vehicles.
        case: of a file with ``case_id``; None: the busiest one.
        time: seconds in the recording; None: frame 10 of a case, or the moment with most moving vehicles
            recorded from 1 s before to 3 s after.
        origin: latitude and longitude of the map's coordinates; None looks beside the tracks.
        align: move tracks beside the lanes onto them, see `align_tracks`.
        force: accept a moment with over half of its vehicles on no lane, as a wrong origin makes them.
        cache: keep the road in ``~/.cache/scex-sumo``.
        progress: True for a bar; or called with (done, total) while SUMO simulates a configuration.

    Raises:
        MapError: the map cannot be read.
        TrackError: the tracks cannot be read, hold no such moment, or lie beside the lanes.

    Example:
        >>> scex.read_seed(scex.example_path("roundabout"), time=4.0).vehicles
        14
    """
    from scex_sumo.converters.datasets.find import find_tracks, map_and_tracks
    from scex_sumo.converters.datasets.recordings import recorded_scene
    from scex_sumo.converters.maps import read_map

    map_path, given = map_and_tracks(Path(map_path), None if tracks is None else Path(tracks))
    try:
        track_path = find_tracks(map_path) if given is None else given
    except TrackError:
        read_map(map_path)  # no map is the likelier reason
        raise
    road = read_map(map_path, origin=origin, tracks=track_path, own_corner=False, keep=cache)
    with progress_of(progress, f"simulating {map_path.name}") as tick:
        scene = recorded_scene(
            map_path,
            tracks=track_path,
            case=case,
            time_s=time,
            road=road,
            align=align,
            force=force,
            progress=tick,
        )
    warn_notes([*road.notes, *scene.notes])
    return scene


def synthetic_seed(
    map_path: str | Path,
    *,
    vehicles: int,
    like: str = "sumo",
    speed: float | None = None,
    seed: int = 0,
    origin: tuple[float, float] | None = None,
    cache: bool = True,
    progress: Progress | bool | None = None,
) -> SeedScene:
    """Populate a map and return one moment: by SUMO with history and future, or as recorded ones look.

    Args:
        map_path: a Lanelet2 map (``.osm``), or a CommonRoad scenario (``.xml``, ``.xml.gz``).
        like: ``sumo`` places vehicles by random demand and car-following, ``recorded`` by the shipped scene
            model; such a scene has no future.
        speed: mean speed of a scene as recorded, m/s; None draws it for road and density.
        seed: the same seed gives the same scene.
        origin: latitude and longitude of the map's coordinates; None looks beside the map, else takes its
            south-west corner.
        cache: keep road, net and scene in ``~/.cache/scex-sumo``.
        progress: True for a bar; or called with the seconds spent and their limit.

    Raises:
        MapError: the map cannot be read.
        SimulationError: the map cannot hold so many vehicles, or is not populated within 10 s.
        UsageError: ``like`` is unknown, or a speed is given to SUMO.

    Example:
        >>> scex.synthetic_seed(scex.example_path("roundabout"), vehicles=3).vehicles
        3
    """
    from scex_sumo.converters.maps import read_map
    from scex_sumo.converters.net.convert import converted
    from scex_sumo.generators.synthetic import synthetic_scene

    if like not in ("sumo", "recorded"):
        raise UsageError(f"--as {like}: unknown; known: sumo, recorded")
    if speed is not None and like == "sumo":
        raise UsageError("--speed: SUMO draws its own; give --as recorded")
    map_path = Path(map_path)
    road = read_map(map_path, origin=origin, own_corner=True, keep=cache)
    if like == "recorded":
        from scex_sumo.generators.generate import generated_scene
        from scex_sumo.generators.scene_model import load_scenes

        warn_notes(road.notes)
        return generated_scene(road, load_scenes(), vehicles=vehicles, speed=speed, seed=seed)
    name = f"{road.name}_synthetic{vehicles}_s{seed}"

    def populated() -> SeedScene:
        with TemporaryFolder() as folder, progress_of(progress, name) as tick:
            net = converted(road, Path(folder) / f"{road.name}.net.xml", keep=cache)
            return synthetic_scene(road, net.path, vehicles=vehicles, seed=seed, name=name, progress=tick)

    if cache:
        made_of = pickle.dumps((version_of("eclipse-sumo"), vehicles, seed, road))
        scene = cached_object("populated", made_of, populated, (SeedScene, States, Obstacles))
    else:
        scene = populated()
    warn_notes(road.notes)
    return dataclasses.replace(scene, road=road)
